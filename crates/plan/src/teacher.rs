//! Jobs in progress from which a spatial policy learns what its next pulse costs in the end.

use lasergym_ablation::{DEFAULT_PULSE_RADIUS_PX, Stream, Task, Workpiece};
use lasergym_geom::{Bitmap, Point, WORKPIECE_SIZE_PX};
use rayon::prelude::*;

use crate::agent::{CORRECTION_REACH_PX, SpatialDecision, VIEW_LEN, write_view};
use crate::polish::{PolishOptions, polish};
use crate::{
    Anneal, AnnealBudget, AnnealOptions, Completion, Job, JobState, PlanError, Planner, PolicyAgent,
};

/// Moves that plan a fresh job.
const FIRST_MOVES: u64 = 250_000;

/// Moves that mend the plan of a job after a pulse.
const MENDING_MOVES: u64 = 15_000;

/// How many pulses a fresh job has.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PulseAllowance {
    /// A number between the two, uniform, each from 1 to 10 000.
    Between(u32, u32),
    /// Area of the target over `area_per_pulse_px`, times a factor uniform in 1 ± `spread`, rounded
    /// up.
    ByArea {
        /// Target per pulse, px, at least 1.
        area_per_pulse_px: f64,
        /// In [0, 0.9].
        spread: f64,
    },
}

/// Settings of a [`Teacher`].
#[derive(Debug, Clone, PartialEq)]
pub struct TeacherOptions {
    /// Where the targets come from.
    pub task: Task,
    /// How many pulses each has.
    pub pulses: PulseAllowance,
    /// Jobs that go on side by side, at least 1.
    pub jobs: usize,
    /// Seed of everything random; job k has the stream of seed + k.
    pub seed: u64,
    /// Metropolis moves by which the other pulses give way to a candidate. Default 3000.
    pub moves: u64,
}

/// What a candidate gains in the end, for many jobs at once; every one of them goes on with the
/// pulses that [`Teacher::fire`] is told, and a new one begins where it is finished.
#[derive(Debug)]
pub struct Teacher {
    lessons: Vec<Lesson>,
    moves: u64,
}

/// One job and the best plan known for what is left of it.
#[derive(Debug)]
struct Lesson {
    options: TeacherOptions,
    stream: Stream,
    state: JobState,
    gain_px: i32,
    plan: Vec<Point>,
}

impl Teacher {
    /// Begins the jobs.
    ///
    /// # Errors
    /// [`PlanError::InvalidOption`] names the first setting out of range.
    pub fn new(options: &TeacherOptions) -> Result<Self, PlanError> {
        options.validate()?;
        let lessons = (0..options.jobs)
            .into_par_iter()
            .map(|k| Lesson::new(options.clone(), options.seed.wrapping_add(k as u64)))
            .collect::<Result<_, _>>()?;
        Ok(Self { lessons, moves: options.moves })
    }

    /// Number of jobs.
    #[must_use]
    pub fn jobs(&self) -> usize {
        self.lessons.len()
    }

    /// Writes what the network sees of every job, [`VIEW_LEN`] values each, and returns the
    /// candidates: the pixels (row, column) of best ring score.
    pub fn observe(&self, views: &mut [f32]) -> Vec<(usize, usize)> {
        self.lessons
            .par_iter()
            .zip(views.par_chunks_exact_mut(VIEW_LEN))
            .map(|(lesson, view)| {
                let candidate = lesson.state.scores().best();
                write_view(&lesson.state, candidate, view);
                candidate
            })
            .collect()
    }

    /// For every job the pixel (row, column) of the pulse of its plan that lies nearest to the
    /// candidate.
    ///
    /// # Errors
    /// As the planner's.
    pub fn planned(&mut self) -> Result<Vec<(usize, usize)>, PlanError> {
        self.lessons.par_iter_mut().map(Lesson::planned).collect()
    }

    /// What every job gains in the end, px, when its next pulse is polished about each of `pixels`
    /// (row, column), `pixels.len() / jobs` for each job in turn, and the rest is planned around it.
    ///
    /// # Errors
    /// [`PlanError::InvalidOption`] for a pixel beside the workpiece or a number of pixels that is
    /// not the same for each job.
    pub fn values_px(&mut self, pixels: &[(usize, usize)]) -> Result<Vec<i32>, PlanError> {
        let each = self.share(pixels.len())?;
        if let Some(&(row, column)) =
            pixels.iter().find(|(row, column)| (*row).max(*column) >= WORKPIECE_SIZE_PX)
        {
            let value = format!("({row}, {column})");
            return Err(PlanError::InvalidOption {
                name: "pixel",
                value,
                expected: "on the workpiece",
            });
        }
        let moves = self.moves;
        let values: Vec<Vec<i32>> = self
            .lessons
            .par_iter_mut()
            .zip(pixels.par_chunks_exact(each))
            .map(|(lesson, pixels)| lesson.values_px(pixels, moves))
            .collect::<Result<_, _>>()?;
        Ok(values.concat())
    }

    /// Fires a pulse in every job where the policy's `corrections` of the ring score say, as
    /// [`PolicyAgent::decide`] does. Where that ends a job, the entry of the result is its gain over
    /// the area of its target, and a new job begins.
    ///
    /// # Errors
    /// [`PlanError::InvalidOption`] for a wrong number of corrections.
    pub fn fire(&mut self, corrections_px: &[f32]) -> Result<Vec<Option<f64>>, PlanError> {
        let each = self.share(corrections_px.len())?;
        let width = 2 * CORRECTION_REACH_PX + 1;
        if each != width * width {
            return Err(PlanError::InvalidOption {
                name: "number of corrections",
                value: each.to_string(),
                expected: "289 for each job",
            });
        }
        self.lessons
            .par_iter_mut()
            .zip(corrections_px.par_chunks_exact(each))
            .map(|(lesson, corrections)| lesson.fire(corrections))
            .collect()
    }

    /// Number of `values` for each job.
    fn share(&self, values: usize) -> Result<usize, PlanError> {
        let jobs = self.lessons.len();
        if values == 0 || !values.is_multiple_of(jobs) {
            return Err(PlanError::InvalidOption {
                name: "number of values",
                value: values.to_string(),
                expected: "the same for each job",
            });
        }
        Ok(values / jobs)
    }
}

impl Lesson {
    fn new(options: TeacherOptions, seed: u64) -> Result<Self, PlanError> {
        let mut stream = Stream::from_seed(seed);
        let state = options.draw(&mut stream)?;
        Ok(Self { options, stream, state, gain_px: 0, plan: Vec::new() })
    }

    /// Brings the plan up to date, one pulse for each that is left.
    fn complete(&mut self) -> Result<Completion, PlanError> {
        let rest = self.state.rest()?;
        let seed = self.state.pulses_left() as u64;
        if self.plan.len() == self.state.pulses_left() {
            let mut completion = Completion::new(&rest, &self.plan, seed)?;
            completion.refine(MENDING_MOVES);
            self.plan = completion.positions();
            return Ok(completion);
        }
        let budget = AnnealBudget::Iterations(FIRST_MOVES);
        let options = AnnealOptions { budget, seed, ..AnnealOptions::default() };
        let mut positions = Anneal { options }.plan_to_end(&rest)?.positions;
        let first = positions.first().copied().unwrap_or(center(self.state.scores().best()));
        positions.resize(self.state.pulses_left(), first);
        let completion = Completion::new(&rest, &positions, seed)?;
        self.plan = completion.positions();
        Ok(completion)
    }

    fn planned(&mut self) -> Result<(usize, usize), PlanError> {
        let candidate = self.state.scores().best();
        let completion = self.complete()?;
        let nearest = completion.nearest_position(center(candidate));
        let pixel = |coordinate: f64| (coordinate as usize).min(WORKPIECE_SIZE_PX - 1);
        Ok(nearest.map_or(candidate, |position| (pixel(position.y), pixel(position.x))))
    }

    fn values_px(&mut self, pixels: &[(usize, usize)], moves: u64) -> Result<Vec<i32>, PlanError> {
        let completion = self.complete()?;
        let polish_options =
            PolishOptions { range_px: SpatialDecision::default().polish_px, steps_per_px: 8 };
        let value_px = |&pixel| {
            let score_px = |position| self.state.score_px(position);
            let (position, _) = polish(center(pixel), polish_options, score_px);
            completion.value_px(position, moves)
        };
        Ok(pixels.iter().map(value_px).collect())
    }

    fn fire(&mut self, corrections_px: &[f32]) -> Result<Option<f64>, PlanError> {
        let position = PolicyAgent::corrected_position(
            &self.state,
            self.state.scores().best(),
            corrections_px,
            SpatialDecision::default().polish_px,
        )?;
        self.gain_px += self.state.pulse(position).gain_px();
        let nearest = self
            .plan
            .iter()
            .enumerate()
            .min_by(|(_, a), (_, b)| a.distance(position).total_cmp(&b.distance(position)));
        if let Some((nearest, _)) = nearest {
            self.plan.swap_remove(nearest);
        }
        if !self.state.is_finished() {
            return Ok(None);
        }
        let gain = f64::from(self.gain_px) / f64::from(self.state.job().target().area_px());
        self.state = self.options.draw(&mut self.stream)?;
        self.plan.clear();
        self.gain_px = 0;
        Ok(Some(gain))
    }
}

impl TeacherOptions {
    fn validate(&self) -> Result<(), PlanError> {
        let check = |ok: bool, name, value: String, expected| {
            if ok { Ok(()) } else { Err(PlanError::InvalidOption { name, value, expected }) }
        };
        check(
            (1..=1_000_000).contains(&self.jobs),
            "jobs",
            self.jobs.to_string(),
            "in 1..=1000000",
        )?;
        match self.pulses {
            PulseAllowance::Between(least, most) => check(
                1 <= least && least <= most && most <= 10_000,
                "pulses",
                format!("between {least} and {most}"),
                "a range within 1..=10000",
            ),
            PulseAllowance::ByArea { area_per_pulse_px, spread } => {
                let ok = (1.0..=1e4).contains(&area_per_pulse_px) && (0.0..=0.9).contains(&spread);
                let value = format!("area / {area_per_pulse_px} ± {spread}");
                check(ok, "pulses", value, "area / 1..=10000 with a spread in [0, 0.9]")
            }
        }
    }

    /// A fresh job.
    fn draw(&self, stream: &mut Stream) -> Result<JobState, PlanError> {
        let target = self.task.draw(stream);
        let pulses = self.pulses.draw(target.area_px(), stream);
        let workpiece = Workpiece::partly_machined(&target, &Bitmap::complement(&target));
        let job = Job::new(workpiece, DEFAULT_PULSE_RADIUS_PX, pulses)?;
        Ok(JobState::new(&job, SpatialDecision::default().ring_weight))
    }
}

impl PulseAllowance {
    fn draw(self, area_px: u32, stream: &mut Stream) -> usize {
        let uniform = stream.uniform();
        let pulses = match self {
            Self::Between(least, most) => {
                f64::from(least) + (uniform * f64::from(most - least + 1)).floor()
            }
            Self::ByArea { area_per_pulse_px, spread } => {
                let factor = 1.0 + spread * (2.0 * uniform - 1.0);
                (f64::from(area_px) / area_per_pulse_px * factor).ceil()
            }
        };
        (pulses as usize).max(1)
    }
}

fn center((row, column): (usize, usize)) -> Point {
    Point::new(column as f64 + 0.5, row as f64 + 0.5)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn options() -> TeacherOptions {
        TeacherOptions {
            task: Task::RandomShape,
            pulses: PulseAllowance::ByArea { area_per_pulse_px: 125.0, spread: 0.1 },
            jobs: 3,
            seed: 5,
            moves: 1000,
        }
    }

    #[test]
    fn jobs_end_with_what_greedy_with_ring_score_gains_where_nothing_is_corrected() {
        let pulses = PulseAllowance::ByArea { area_per_pulse_px: 125.0, spread: 0.0 };
        let mut teacher = Teacher::new(&TeacherOptions { pulses, ..options() }).unwrap();
        let jobs: Vec<Job> = teacher.lessons.iter().map(|l| l.state.job().clone()).collect();
        let mut ends = vec![None; 3];
        while ends.iter().any(Option::is_none) {
            let fired = teacher.fire(&[0.0; 3 * 289]).unwrap();
            for (end, fired) in ends.iter_mut().zip(fired) {
                *end = end.or(fired);
            }
        }
        let polish = PolishOptions { range_px: 0.5, steps_per_px: 8 };
        for (job, end) in jobs.iter().zip(ends) {
            let plan = crate::Greedy { ring_weight: 0.35, polish }.plan_to_end(job).unwrap();
            let expected = plan.score.reward / job.reward_limit();
            assert!((end.unwrap() - expected).abs() < 0.01, "{end:?} {expected}");
        }
    }

    #[test]
    fn the_pulse_of_the_plan_is_worth_more_than_a_bad_one() {
        let mut teacher = Teacher::new(&options()).unwrap();
        let planned = teacher.planned().unwrap();
        let pixels: Vec<_> = planned.iter().flat_map(|&pixel| [pixel, (0, 0)]).collect();
        let values = teacher.values_px(&pixels).unwrap();
        for pair in values.chunks(2) {
            assert!(pair[0] > pair[1], "{pair:?}");
        }
    }

    #[test]
    fn teachers_of_the_same_seed_agree() {
        let [one, other] = [(); 2].map(|()| {
            let mut teacher = Teacher::new(&options()).unwrap();
            let pixels = teacher.planned().unwrap();
            teacher.fire(&[0.5; 3 * 289]).unwrap();
            let values = teacher.values_px(&pixels).unwrap();
            let mut views = vec![0.0; 3 * VIEW_LEN];
            (teacher.observe(&mut views), values, views)
        });
        assert!(one == other);
    }

    #[test]
    fn settings_out_of_range_are_refused() {
        let by_area =
            |area_per_pulse_px, spread| PulseAllowance::ByArea { area_per_pulse_px, spread };
        for bad in [
            TeacherOptions { jobs: 0, ..options() },
            TeacherOptions { pulses: PulseAllowance::Between(0, 5), ..options() },
            TeacherOptions { pulses: PulseAllowance::Between(6, 5), ..options() },
            TeacherOptions { pulses: by_area(0.5, 0.1), ..options() },
            TeacherOptions { pulses: by_area(125.0, f64::NAN), ..options() },
        ] {
            let error = Teacher::new(&bad).unwrap_err();
            assert!(matches!(error, PlanError::InvalidOption { .. }), "{error}");
        }
    }

    #[test]
    fn pixels_and_corrections_that_do_not_fit_are_refused() {
        let mut teacher = Teacher::new(&options()).unwrap();
        assert!(teacher.values_px(&[(0, 0); 4]).is_err());
        assert!(teacher.values_px(&[(0, 0), (100, 0), (0, 0)]).is_err());
        assert!(teacher.values_px(&[]).is_err());
        assert!(teacher.fire(&[0.0; 3 * 288]).is_err());
    }
}
