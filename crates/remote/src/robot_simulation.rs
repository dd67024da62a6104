//! The simulated robot: it runs its program cycle by cycle and knows nothing of plans.

use crate::plane::distance_mm;
use crate::{Pose, RobotMove, RobotProgram};

/// Distances below this are rounding, mm.
const NEAR_MM: f64 = 1e-6;

/// The robot acts on a trigger in the first cycle in which it has come this near to it, mm: the
/// resolution of programmed places.
const TRIGGER_MM: f64 = 1e-3;

/// A straight move as it was run.
#[derive(Debug, Clone)]
pub(crate) struct LineRun {
    /// Where it began and ended.
    pub(crate) from: Pose,
    pub(crate) to: Pose,
    /// When it began, s.
    pub(crate) begin_s: f64,
    /// Distance from its start at the end of each cycle, mm; 0 first.
    pub(crate) distances_mm: Vec<f64>,
    /// Cycle in which the scanner was started.
    pub(crate) trigger_cycle: Option<usize>,
    /// List that was started.
    pub(crate) list: u32,
    /// Highest speed, mm/s.
    pub(crate) speed_mm_s: f64,
}

impl LineRun {
    /// Where the robot is `time_s` after the start of the move, mm: between cycles it moves uniformly.
    pub(crate) fn place_mm(&self, time_s: f64, cycle_s: f64) -> [f64; 3] {
        let last = self.distances_mm.len() - 1;
        let at = (time_s / cycle_s).clamp(0.0, last as f64);
        let index = (at as usize).min(last.saturating_sub(1));
        let next = self.distances_mm[(index + 1).min(last)];
        let here = self.distances_mm[index];
        let way_mm = here + (next - here) * (at - index as f64);
        let length_mm = distance_mm(self.from.place_mm, self.to.place_mm);
        let part = if length_mm > 0.0 { way_mm / length_mm } else { 0.0 };
        [0, 1, 2].map(|axis| {
            let (from, to) = (self.from.place_mm[axis], self.to.place_mm[axis]);
            from + part * (to - from)
        })
    }

    /// Time that the move took, s.
    pub(crate) fn time_s(&self, cycle_s: f64) -> f64 {
        (self.distances_mm.len() - 1) as f64 * cycle_s
    }
}

/// A move between lines, or a wait.
#[derive(Debug, Clone)]
pub(crate) struct IdleRun {
    pub(crate) from: Pose,
    pub(crate) to: Pose,
    pub(crate) begin_s: f64,
    pub(crate) time_s: f64,
}

/// A program as it was run.
#[derive(Debug, Default)]
pub(crate) struct RobotRun {
    pub(crate) lines: Vec<LineRun>,
    pub(crate) idle: Vec<IdleRun>,
    /// Time of everything, s.
    pub(crate) total_s: f64,
}

/// Runs `program` from its first place on.
pub(crate) fn run_robot(program: &RobotProgram, cycle_s: f64) -> RobotRun {
    let mut run = RobotRun::default();
    let mut here: Option<Pose> = None;
    for one in &program.moves {
        match *one {
            RobotMove::Ptp { to, speed_mm_s, acceleration_mm_s2 } => {
                if let Some(from) = here {
                    let length_mm = distance_mm(from.place_mm, to.place_mm);
                    let cycles =
                        profile(length_mm, speed_mm_s, acceleration_mm_s2, cycle_s).len() - 1;
                    run.pause(from, to, cycles as f64 * cycle_s);
                }
                here = Some(to);
            }
            RobotMove::Wait { time_s } => {
                let at = here.unwrap_or_default();
                let cycles = (time_s / cycle_s - 1e-6).ceil().max(0.0);
                run.pause(at, at, cycles * cycle_s);
            }
            RobotMove::Line { to, speed_mm_s, acceleration_mm_s2, trigger_mm, list } => {
                let from = here.unwrap_or(to);
                let length_mm = distance_mm(from.place_mm, to.place_mm);
                let distances_mm = profile(length_mm, speed_mm_s, acceleration_mm_s2, cycle_s);
                let trigger_cycle =
                    distances_mm.iter().position(|&way| way >= trigger_mm - TRIGGER_MM);
                let fastest =
                    distances_mm.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max);
                let line = LineRun {
                    from,
                    to,
                    begin_s: run.total_s,
                    distances_mm,
                    trigger_cycle,
                    list,
                    speed_mm_s: fastest / cycle_s,
                };
                run.total_s += line.time_s(cycle_s);
                run.lines.push(line);
                here = Some(to);
            }
        }
    }
    run
}

impl RobotRun {
    fn pause(&mut self, from: Pose, to: Pose, time_s: f64) {
        self.idle.push(IdleRun { from, to, begin_s: self.total_s, time_s });
        self.total_s += time_s;
    }
}

/// Distances at the end of each cycle of a move from rest to rest: in every cycle the robot goes as
/// fast as it may and can still stop at the end.
fn profile(length_mm: f64, speed_mm_s: f64, acceleration_mm_s2: f64, cycle_s: f64) -> Vec<f64> {
    let mut distances = vec![0.0];
    let (mut way_mm, mut now_mm_s) = (0.0, 0.0);
    while length_mm - way_mm > NEAR_MM {
        let fastest = (now_mm_s + acceleration_mm_s2 * cycle_s).min(speed_mm_s);
        // The speed v with which this cycle's way and v²/(2 a) just reach the end.
        let left_mm = length_mm - way_mm - 0.5 * now_mm_s * cycle_s;
        let half_s = 0.5 * cycle_s;
        let root = half_s * half_s + 2.0 * left_mm / acceleration_mm_s2;
        let stopping = acceleration_mm_s2 * (root.max(0.0).sqrt() - half_s);
        let next = fastest.min(stopping).max(0.0);
        way_mm += 0.5 * (now_mm_s + next) * cycle_s;
        now_mm_s = next;
        if now_mm_s <= 0.0 {
            way_mm = length_mm;
        }
        way_mm = way_mm.min(length_mm);
        distances.push(way_mm);
    }
    distances
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn moves_take_the_time_of_their_trapezium(
            length_mm in 0.1..900.0, speed in 20.0..900.0, acceleration in 500.0..5000.0,
        ) {
            let cycles = profile(length_mm, speed, acceleration, 1e-3).len() as f64 - 1.0;
            let ramp_mm = speed * speed / acceleration;
            let exact_s = if length_mm >= ramp_mm {
                length_mm / speed + speed / acceleration
            } else {
                2.0 * f64::sqrt(length_mm / acceleration)
            };
            prop_assert!((cycles * 1e-3 - exact_s).abs() <= 3.1e-3, "{cycles} {exact_s}");
        }

        #[test]
        fn speed_and_acceleration_keep_their_limits(length_mm in 0.1..300.0, speed in 20.0..400.0) {
            let distances = profile(length_mm, speed, 2000.0, 1e-3);
            for pair in distances.windows(2) {
                prop_assert!(pair[1] >= pair[0] && pair[1] - pair[0] <= speed * 1e-3 + 1e-9);
            }
            for three in distances.windows(3) {
                let change = (three[2] - 2.0 * three[1] + three[0]) / 1e-6;
                prop_assert!(change <= 2000.0 * (1.0 + 1e-6));
            }
            prop_assert!((distances[distances.len() - 1] - length_mm).abs() < 1e-6);
        }
    }
}
