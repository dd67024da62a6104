//! The motion of the beam over a subtask in whole cycles of the scanner's clock.
//!
//! A path is divided at its corners. Each stretch between corners takes whole cycles, so that the
//! beam turns a corner exactly on a cycle and has constant speed between; a closed path without
//! corners is one stretch over all exposures. Open paths are exposed to and fro.

use lasergym_geom::Point;

use crate::beam_path::PathPiece;
use crate::{RemoteError, Scanner, Subtask};

/// Turns sharper than this are corners, rad (10°): within one cycle, a smaller one changes the speed
/// by less than 0.4 %.
const CORNER_RAD: f64 = 0.174_5;

/// A part of an exposure between two corners.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Stretch {
    /// Distance of its start from the start of the path, mm.
    begin_mm: f64,
    /// Its length, mm.
    length_mm: f64,
    /// Cycle of the exposure at which it begins.
    begin_cycle: u64,
    /// Cycles that it takes.
    cycles: u64,
}

/// Where the beam is at every cycle of a subtask.
#[derive(Debug, Clone, PartialEq)]
pub struct BeamMotion {
    pieces: Vec<PathPiece>,
    /// Distance of each piece's start from that of the path, mm; the length of the path is last.
    begins_mm: Vec<f64>,
    stretches: Vec<Stretch>,
    /// Cycles of one exposure; of all of them where the path is closed and has no corner.
    exposure_cycles: u64,
    exposures: u32,
    to_and_fro: bool,
}

impl BeamMotion {
    /// The motion over `subtask`.
    ///
    /// # Errors
    /// [`RemoteError::OffClock`] when whole cycles change the speed of a stretch by more than the
    /// scanner's `clock_tolerance`.
    pub fn new(subtask: &Subtask, scanner: &Scanner) -> Result<Self, RemoteError> {
        let path = &subtask.path;
        let pieces: Vec<PathPiece> =
            path.pieces().iter().filter(|piece| piece.length_mm() > 0.0).copied().collect();
        let mut begins_mm = vec![0.0];
        let mut corners_mm = vec![0.0];
        for (index, piece) in pieces.iter().enumerate() {
            let end_mm = begins_mm[index] + piece.length_mm();
            begins_mm.push(end_mm);
            if pieces.get(index + 1).is_some_and(|next| is_corner(piece, next)) {
                corners_mm.push(end_mm);
            }
        }
        let length_mm = begins_mm[pieces.len()];
        corners_mm.push(length_mm);
        let closed = path.is_closed();
        let exposures = subtask.process.exposures;
        let smooth = closed
            && corners_mm.len() == 2
            && pieces
                .last()
                .zip(pieces.first())
                .is_some_and(|(last, first)| !is_corner(last, first));
        let mut stretches = Vec::new();
        let mut begin_cycle = 0;
        // A smooth loop goes round and round in one stretch.
        let turns = if smooth { f64::from(exposures) } else { 1.0 };
        for pair in corners_mm.windows(2).filter(|_| length_mm > 0.0) {
            let stretch_mm = (pair[1] - pair[0]) * turns;
            let cycles = whole_cycles(subtask, scanner, stretch_mm)?;
            stretches.push(Stretch {
                begin_mm: pair[0],
                length_mm: stretch_mm,
                begin_cycle,
                cycles,
            });
            begin_cycle += cycles;
        }
        let spot = path.start();
        Ok(Self {
            pieces: if pieces.is_empty() {
                vec![PathPiece::Line { from: spot, to: spot }]
            } else {
                pieces
            },
            begins_mm,
            stretches,
            exposure_cycles: begin_cycle,
            exposures: if smooth { 1 } else { exposures },
            to_and_fro: !closed,
        })
    }

    /// Cycles that the subtask takes.
    #[must_use]
    pub fn cycles(&self) -> u64 {
        self.exposure_cycles * u64::from(self.exposures)
    }

    /// The beam on the workpiece `cycle` cycles after the start, mm.
    #[must_use]
    pub fn at(&self, cycle: u64) -> Point {
        if self.exposure_cycles == 0 {
            return self.pieces[0].at(0.0);
        }
        let last = u64::from(self.exposures) - 1;
        let exposure = (cycle / self.exposure_cycles).min(last);
        let mut within = (cycle - exposure * self.exposure_cycles).min(self.exposure_cycles);
        if self.to_and_fro && exposure % 2 == 1 {
            within = self.exposure_cycles - within;
        }
        let index = self.stretches.partition_point(|stretch| stretch.begin_cycle <= within) - 1;
        let stretch = &self.stretches[index];
        let part = (within - stretch.begin_cycle) as f64 / stretch.cycles as f64;
        self.on_path(stretch.begin_mm + part * stretch.length_mm)
    }

    /// Cycles after the start at which straight movement from the last of them, which begin with 0,
    /// leaves the path by no more than `tolerance_mm`; the last one is that of the end.
    #[must_use]
    pub fn chord_cycles(&self, tolerance_mm: f64) -> Vec<u64> {
        let mut cycles = vec![0];
        for exposure in 0..u64::from(self.exposures) {
            let begin = exposure * self.exposure_cycles;
            let backwards = self.to_and_fro && exposure % 2 == 1;
            let within = self.exposure_chords(tolerance_mm);
            if backwards {
                let turned = within.iter().rev().skip(1);
                cycles.extend(turned.map(|cycle| begin + self.exposure_cycles - cycle));
            } else {
                cycles.extend(within[1..].iter().map(|cycle| begin + cycle));
            }
        }
        cycles
    }

    /// The chords of one exposure, in cycles from its start.
    fn exposure_chords(&self, tolerance_mm: f64) -> Vec<u64> {
        let mut chords = vec![0];
        for stretch in &self.stretches {
            let mm_per_cycle = stretch.length_mm / stretch.cycles as f64;
            let end_mm = stretch.begin_mm + stretch.length_mm;
            let mut here_mm = stretch.begin_mm;
            let mut here = stretch.begin_cycle;
            while here < stretch.begin_cycle + stretch.cycles {
                let (index, _) = self.place(here_mm + 0.5 * mm_per_cycle);
                let turn_mm = self.turn_mm(here_mm + 0.5 * mm_per_cycle);
                let chord_mm = match self.pieces[index] {
                    PathPiece::Line { .. } => f64::INFINITY,
                    PathPiece::Arc { radius_mm, .. } => (8.0 * radius_mm * tolerance_mm).sqrt(),
                };
                let piece_end_mm = turn_mm + self.begins_mm[index + 1];
                let next_mm = (here_mm + chord_mm).min(piece_end_mm).min(end_mm);
                let forward = ((next_mm - stretch.begin_mm) / mm_per_cycle + 1e-6).floor() as u64;
                here = (stretch.begin_cycle + forward)
                    .max(here + 1)
                    .min(stretch.begin_cycle + stretch.cycles);
                here_mm = stretch.begin_mm + (here - stretch.begin_cycle) as f64 * mm_per_cycle;
                chords.push(here);
            }
        }
        chords
    }

    /// Length of the whole turns of a loop before `distance_mm`.
    fn turn_mm(&self, distance_mm: f64) -> f64 {
        let length_mm = self.begins_mm[self.pieces.len()];
        (distance_mm / length_mm).floor() * length_mm
    }

    /// The piece at a distance along the path, which goes on round a loop, and the part of it.
    fn place(&self, distance_mm: f64) -> (usize, f64) {
        let length_mm = self.begins_mm[self.pieces.len()];
        let mut within_mm = distance_mm;
        if distance_mm > length_mm {
            within_mm = distance_mm.rem_euclid(length_mm);
        }
        let next = self.begins_mm.partition_point(|&begin_mm| begin_mm <= within_mm);
        let index = next.saturating_sub(1).min(self.pieces.len() - 1);
        let piece_mm = self.begins_mm[index + 1] - self.begins_mm[index];
        (index, ((within_mm - self.begins_mm[index]) / piece_mm).clamp(0.0, 1.0))
    }

    fn on_path(&self, distance_mm: f64) -> Point {
        let (index, part) = self.place(distance_mm);
        self.pieces[index].at(part)
    }
}

fn is_corner(before: &PathPiece, after: &PathPiece) -> bool {
    let (a, b) = (before.heading(true), after.heading(false));
    (a.x * b.y - a.y * b.x).atan2(a.x * b.x + a.y * b.y).abs() > CORNER_RAD
}

/// Cycles of a stretch, at least 1.
fn whole_cycles(subtask: &Subtask, scanner: &Scanner, length_mm: f64) -> Result<u64, RemoteError> {
    let speed_mm_s = subtask.process.speed_mm_s;
    let cycles = length_mm / speed_mm_s / scanner.cycle_s();
    let whole = cycles.round().max(1.0);
    let change = (cycles / whole - 1.0).abs();
    if change > scanner.clock_tolerance {
        return Err(RemoteError::OffClock {
            subtask: subtask.name.clone(),
            length_mm,
            cycles,
            speed_mm_s,
            change_percent: 100.0 * change,
            better_mm_s: length_mm / (cycles.ceil().max(1.0) * scanner.cycle_s()),
        });
    }
    Ok(whole as u64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{BeamPath, Process};

    fn subtask(path: BeamPath, speed_mm_s: f64, exposures: u32) -> Subtask {
        let process = Process { speed_mm_s, exposures, ..Process::default() };
        Subtask { name: "hole".into(), plane: 0, path, process }
    }

    fn point(x: f64, y: f64) -> Point {
        Point::new(x, y)
    }

    #[test]
    fn a_circle_goes_round_as_often_as_it_is_exposed() {
        let path = BeamPath::circle(point(5.0, 5.0), 60.0).unwrap();
        let motion = BeamMotion::new(&subtask(path, 6000.0, 10), &Scanner::default()).unwrap();
        // 10 · π · 120 mm at 6 m/s in cycles of 10 µs.
        assert_eq!(motion.cycles(), 62_832);
        let way: f64 = (0..motion.cycles()).map(|k| motion.at(k).distance(motion.at(k + 1))).sum();
        assert!((way - 10.0 * 120.0 * std::f64::consts::PI).abs() < 1e-2, "{way}");
        assert!(motion.at(motion.cycles()).distance(point(65.0, 5.0)) < 1e-9);
        for cycle in motion.chord_cycles(1e-3).windows(2) {
            let middle = (motion.at(cycle[0]) + motion.at(cycle[1])) * 0.5;
            assert!((middle.distance(point(5.0, 5.0)) - 60.0).abs() < 1.1e-3);
        }
    }

    #[test]
    fn an_open_path_goes_to_and_fro() {
        let path = BeamPath::line(point(0.0, 0.0), point(60.0, 0.0)).unwrap();
        let motion = BeamMotion::new(&subtask(path, 6000.0, 3), &Scanner::default()).unwrap();
        assert_eq!(motion.cycles(), 3000);
        assert_eq!(motion.at(1000), point(60.0, 0.0));
        assert!(motion.at(1500).distance(point(30.0, 0.0)) < 1e-9);
        assert_eq!(motion.chord_cycles(1e-3), [0, 1000, 2000, 3000]);
        assert_eq!(motion.at(motion.cycles()), point(60.0, 0.0));
    }

    #[test]
    fn corners_lie_on_cycles() {
        let corners = [point(0.0, 0.0), point(10.003, 0.0), point(10.003, 7.001), point(0.0, 0.0)];
        let path = BeamPath::polyline(&corners).unwrap();
        let motion = BeamMotion::new(&subtask(path, 1000.0, 2), &Scanner::default()).unwrap();
        let chords = motion.chord_cycles(1e-3);
        assert_eq!(chords.len(), 7);
        for (&cycle, corner) in chords.iter().zip(corners) {
            assert!(motion.at(cycle).distance(corner) < 1e-9, "{cycle}");
        }
    }

    #[test]
    fn a_stretch_too_short_for_the_clock_is_refused() {
        let path = BeamPath::line(point(0.0, 0.0), point(0.5, 0.0)).unwrap();
        let error =
            BeamMotion::new(&subtask(path.clone(), 6000.0, 1), &Scanner::default()).unwrap_err();
        let RemoteError::OffClock { better_mm_s, .. } = error else { panic!("{error}") };
        BeamMotion::new(&subtask(path, better_mm_s, 1), &Scanner::default()).unwrap();
    }

    #[test]
    fn a_spot_takes_no_time() {
        let spot = point(1.0, 2.0);
        let path = BeamPath::line(spot, spot).unwrap();
        let motion = BeamMotion::new(&subtask(path, 6000.0, 3), &Scanner::default()).unwrap();
        assert_eq!((motion.cycles(), motion.at(0)), (0, spot));
        assert_eq!(motion.chord_cycles(1e-3), [0]);
    }
}
