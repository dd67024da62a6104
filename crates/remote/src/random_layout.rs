//! Random layouts of holes and seams, for comparisons and for the environment.

use lasergym_geom::Point;
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;

use crate::error::check_option;
use crate::{BeamPath, Process, ProcessKind, RemoteError, RemoteTask, Subtask};

/// Holes to be cut and lines to be welded, spread over a sheet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RandomLayout {
    /// Number of subtasks, from 1 to 100 000.
    pub subtasks: usize,
    /// Area of the sheet for each of them, mm², above 0. The default of 75 000 mm² spreads thirty over
    /// 1500 mm × 1500 mm.
    pub area_mm2: f64,
    /// Part of the subtasks that are welded, in [0, 1]; 0.2 by default.
    pub welded: f64,
}

impl Default for RandomLayout {
    fn default() -> Self {
        Self { subtasks: 30, area_mm2: 75_000.0, welded: 0.2 }
    }
}

impl RandomLayout {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`RemoteError::InvalidOption`].
    pub fn validate(&self) -> Result<(), RemoteError> {
        let count = self.subtasks;
        let ok = (1..=100_000).contains(&count);
        check_option("subtasks", count as f64, ok, "from 1 to 100000")?;
        let ok = self.area_mm2 > 0.0 && self.area_mm2 <= 1e8;
        check_option("area_mm2", self.area_mm2, ok, "above 0 and at most 1e8 mm²")?;
        let ok = (0.0..=1.0).contains(&self.welded);
        check_option("welded", self.welded, ok, "from 0 to 1")
    }

    /// Side of the square sheet, mm.
    #[must_use]
    pub fn side_mm(&self) -> f64 {
        (self.subtasks as f64 * self.area_mm2).sqrt()
    }

    /// The layout of a seed: holes of 10 to 60 mm radius with 5 to 14 exposures at 6000 mm/s, and
    /// straight seams of 20 to 100 mm at 200 mm/s.
    ///
    /// # Errors
    /// As [`Self::validate`].
    pub fn task(&self, seed: u64) -> Result<RemoteTask, RemoteError> {
        self.validate()?;
        let mut generator = Pcg64::seed_from_u64(seed);
        let mut uniform = |low: f64, high: f64| {
            let part = (generator.next_u64() >> 11) as f64 * (1.0 / (1_u64 << 53) as f64);
            low + part * (high - low)
        };
        let side_mm = self.side_mm();
        let mut subtasks = Vec::with_capacity(self.subtasks);
        for index in 0..self.subtasks {
            let center = Point::new(uniform(0.0, side_mm), uniform(0.0, side_mm));
            let weld = uniform(0.0, 1.0) < self.welded;
            let (size, turn) = (uniform(10.0, 60.0), uniform(0.0, std::f64::consts::TAU));
            let exposures = uniform(5.0, 15.0) as u32;
            let (path, process) = if weld {
                let arm = Point::new(turn.cos(), turn.sin()) * (10.0 + 0.8 * (size - 10.0));
                let process =
                    Process { kind: ProcessKind::Welding, speed_mm_s: 200.0, ..Process::default() };
                (BeamPath::line(center - arm, center + arm), process)
            } else {
                (BeamPath::circle(center, size), Process { exposures, ..Process::default() })
            };
            let name = format!("{} {}", if weld { "seam" } else { "hole" }, index + 1);
            let path =
                path.map_err(|problem| RemoteError::Path { subtask: name.clone(), problem })?;
            subtasks.push(Subtask { name, plane: 0, path, process });
        }
        let mut task = RemoteTask::new(subtasks);
        task.name = format!("layout {seed}");
        Ok(task)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_seed_gives_the_same_layout_again() {
        let layout = RandomLayout::default();
        let task = layout.task(7).unwrap();
        assert_eq!(task, layout.task(7).unwrap());
        assert_ne!(task, layout.task(8).unwrap());
        assert_eq!(task.subtasks.len(), 30);
        task.validate().unwrap();
        for subtask in &task.subtasks {
            assert!(subtask.path.start().length() < 2.0 * layout.side_mm());
        }
    }

    #[test]
    fn values_out_of_range_are_refused() {
        let layout = RandomLayout::default();
        for bad in [
            RandomLayout { subtasks: 0, ..layout },
            RandomLayout { area_mm2: f64::NAN, ..layout },
            RandomLayout { welded: 1.5, ..layout },
        ] {
            assert!(matches!(bad.task(0), Err(RemoteError::InvalidOption { .. })));
        }
    }
}
