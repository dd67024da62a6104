//! Last touches to chosen lines: each is searched in full, and turned and shifted where that shortens
//! the ways from and to its neighbours by more than it lengthens the line.

use crate::grouping::Share;
use crate::robot_line::common_speeds;
use crate::route::{RoutedLine, Router};
use crate::{DirectionSearch, RobotLine, ScanCircle};

/// Rounds over all lines.
const ROUNDS: usize = 2;

/// First change of direction, rad, and of offset, mm.
const FIRST_STEPS: (f64, f64) = (0.2, 20.0);

/// Halvings of the changes.
const HALVINGS: u32 = 7;

/// Improves each line between its neighbours; the cycle time never grows.
pub(crate) fn place_between(
    shares: &mut [Share],
    circles: &[ScanCircle],
    router: &Router<'_>,
    search: DirectionSearch,
) {
    for round in 0..ROUNDS {
        for index in 0..shares.len() {
            let stops = &circles[shares[index].stops.clone()];
            let speeds = common_speeds(stops, router.slowest_mm_s());
            let jump_s = router.jump_s();
            let plane = shares[index].line.plane;
            let (before, rest) = shares.split_at_mut(index);
            let Some((share, after)) = rest.split_first_mut() else { continue };
            let (before, after) = (before.last().map(|s| &s.line), after.first().map(|s| &s.line));
            let cost = |line: &RoutedLine| {
                line.time_s
                    + before.map_or(0.0, |before| router.ptp_s(before, line))
                    + after.map_or(0.0, |after| router.ptp_s(line, after))
            };
            let mut best_s = cost(&share.line);
            let mut keep = |candidate: Option<RobotLine>, share: &mut Share| {
                let Some(line) = candidate else { return false };
                let routed = router.route(line, plane);
                let cost_s = cost(&routed);
                let better = cost_s < best_s - 1e-9;
                if better {
                    best_s = cost_s;
                    share.line = routed;
                }
                better
            };
            if round == 0 && stops.len() > 1 {
                keep(RobotLine::best(stops, speeds, jump_s, search), share);
            }
            let (mut turn_rad, mut shift_mm) = FIRST_STEPS;
            for _ in 0..HALVINGS {
                for (turn, shift) in
                    [(turn_rad, 0.0), (-turn_rad, 0.0), (0.0, shift_mm), (0.0, -shift_mm)]
                {
                    let line = &share.line.line;
                    let direction_rad = line.direction_rad + turn;
                    // Turned about the middle of the line.
                    let middle = line.place(0.5 * (line.start_mm + line.end_mm));
                    let offset_mm = crate::LineFunctions::offset_of(direction_rad, middle) + shift;
                    let turned = RobotLine::at(stops, direction_rad, offset_mm, speeds, jump_s);
                    keep(turned, share);
                }
                turn_rad *= 0.5;
                shift_mm *= 0.5;
            }
        }
    }
}
