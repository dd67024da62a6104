//! Planning as a sequence of decisions: which subtask next, and on which line.
//!
//! An action is a subtask and a direction. Direction 0 goes on with the line of the robot, if the
//! subtask can be processed on it after the others, in its direction; otherwise, and with a direction
//! from 1 on, a new line begins. The reward is minus the time that the choice adds to the cycle, s, so
//! that the return is minus the cycle time. Lines are searched and timed as in plans.

use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;

use crate::robot_line::common_speeds;
use crate::route::Router;
use crate::{RandomLayout, RemoteError, RemoteTask, RobotLine, RoutedLine, ScanCircle, stops_of};

/// Directions of a new line: multiples of 22.5°.
pub const DIRECTIONS: usize = 16;

/// Time that choosing a subtask costs which is done already, s.
pub const REPEAT_PENALTY_S: f64 = 1.0;

/// Numbers that describe one subtask in an observation.
pub const SUBTASK_FEATURES: usize = 6;

/// Numbers that describe the robot in an observation.
pub const ROBOT_FEATURES: usize = 6;

/// The choice of subtask and line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ScanAction {
    /// Index of the subtask.
    pub subtask: usize,
    /// 0 goes on with the line, `k` begins one in the direction (k − 1) · 22.5°.
    pub direction: usize,
}

/// What a step did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScanStep {
    /// Minus the time that it added, s.
    pub reward: f64,
    /// Whether the episode is over: all is done, or the steps are used up.
    pub terminated: bool,
}

/// How far an episode has come.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ScanProgress {
    /// Subtasks done.
    pub done: usize,
    /// Lines begun.
    pub lines: usize,
    /// Time so far, penalties left out, s.
    pub cycle_time_s: f64,
    /// Whether every subtask is done.
    pub is_success: bool,
}

/// One random layout after another, planned step by step.
#[derive(Debug, Clone)]
pub struct ScanEnvironment {
    layout: RandomLayout,
    stream: Pcg64,
    task: RemoteTask,
    circles: Vec<ScanCircle>,
    done: Vec<bool>,
    finished: Vec<RoutedLine>,
    current: Vec<usize>,
    current_line: Option<RoutedLine>,
    finished_s: f64,
    steps: usize,
    over: bool,
}

impl ScanEnvironment {
    /// An environment before its first reset, with the random stream of seed 0.
    ///
    /// # Errors
    /// As [`RandomLayout::validate`].
    pub fn new(layout: RandomLayout) -> Result<Self, RemoteError> {
        let mut made = Self {
            task: layout.task(0)?,
            layout,
            stream: Pcg64::seed_from_u64(0),
            circles: Vec::new(),
            done: Vec::new(),
            finished: Vec::new(),
            current: Vec::new(),
            current_line: None,
            finished_s: 0.0,
            steps: 0,
            over: true,
        };
        made.begin(0)?;
        made.over = true;
        Ok(made)
    }

    /// Begins an episode with the next layout of the random stream, which `seed` starts anew.
    ///
    /// # Errors
    /// As [`stops_of`], which random layouts do not give.
    pub fn reset(&mut self, seed: Option<u64>) -> Result<(), RemoteError> {
        if let Some(seed) = seed {
            self.stream = Pcg64::seed_from_u64(seed);
        }
        let layout_seed = self.stream.next_u64();
        self.begin(layout_seed)
    }

    /// Begins an episode with the layout of `seed`.
    fn begin(&mut self, seed: u64) -> Result<(), RemoteError> {
        self.task = self.layout.task(seed)?;
        self.circles = stops_of(&self.task)?.iter().map(|stop| stop.scan_circle).collect();
        self.done = vec![false; self.circles.len()];
        self.finished.clear();
        self.current.clear();
        self.current_line = None;
        self.finished_s = 0.0;
        self.steps = 0;
        self.over = false;
        Ok(())
    }

    /// Number of subtasks.
    #[must_use]
    pub fn subtasks(&self) -> usize {
        self.circles.len()
    }

    /// The task of this episode.
    #[must_use]
    pub fn task(&self) -> &RemoteTask {
        &self.task
    }

    /// The random layouts of the episodes.
    #[must_use]
    pub fn layout(&self) -> &RandomLayout {
        &self.layout
    }

    /// Numbers of an observation.
    #[must_use]
    pub fn observation_len(&self) -> usize {
        ROBOT_FEATURES + SUBTASK_FEATURES * self.subtasks()
    }

    /// Which subtasks are done.
    #[must_use]
    pub fn done(&self) -> &[bool] {
        &self.done
    }

    /// The lines so far, the one that may still go on last.
    pub fn lines(&self) -> impl Iterator<Item = &RoutedLine> {
        self.finished.iter().chain(&self.current_line)
    }

    /// Whether a reset is needed.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.over
    }

    /// How far the episode has come.
    #[must_use]
    pub fn progress(&self) -> ScanProgress {
        let done = self.done.iter().filter(|&&done| done).count();
        ScanProgress {
            done,
            lines: self.lines().count(),
            cycle_time_s: self.total_s(self.current_line.as_ref()),
            is_success: done == self.done.len(),
        }
    }

    /// Checks an action.
    ///
    /// # Errors
    /// [`RemoteError::Action`] where it names no subtask or direction.
    pub fn action(&self, [subtask, direction]: [i64; 2]) -> Result<ScanAction, RemoteError> {
        let below = |value: i64, limit: usize| usize::try_from(value).ok().filter(|&v| v < limit);
        match (below(subtask, self.subtasks()), below(direction, DIRECTIONS + 1)) {
            (Some(subtask), Some(direction)) => Ok(ScanAction { subtask, direction }),
            _ => Err(RemoteError::Action {
                action: [subtask, direction],
                subtasks: self.subtasks(),
                directions: DIRECTIONS,
            }),
        }
    }

    /// Processes one subtask next.
    ///
    /// # Errors
    /// [`RemoteError::EpisodeOver`].
    pub fn step(&mut self, action: ScanAction) -> Result<ScanStep, RemoteError> {
        if self.over {
            return Err(RemoteError::EpisodeOver { environment: 0 });
        }
        self.steps += 1;
        let before_s = self.total_s(self.current_line.as_ref());
        let mut penalty_s = 0.0;
        if self.done[action.subtask] {
            penalty_s = REPEAT_PENALTY_S;
        } else {
            self.process(action);
        }
        let all_done = self.done.iter().all(|&done| done);
        self.over = all_done || self.steps >= 2 * self.subtasks();
        let reward = before_s - self.total_s(self.current_line.as_ref()) - penalty_s;
        Ok(ScanStep { reward, terminated: self.over })
    }

    /// Writes the observation: for the robot (x, y, cos, sin of the line's direction, whether there is
    /// a line, part of the steps used), then for each subtask (x, y, radius of the scan circle, time
    /// of the process, done, whether the line can go on with it). Places are in [0, 1] of the sheet;
    /// radii are parts of the field; times are parts of 4 s.
    ///
    /// # Errors
    /// [`RemoteError::WrongLength`].
    pub fn observe(&self, observation: &mut [f32]) -> Result<(), RemoteError> {
        let expected = self.observation_len();
        if observation.len() != expected {
            let actual = observation.len();
            return Err(RemoteError::WrongLength { name: "observation", actual, expected });
        }
        let side_mm = self.layout.side_mm();
        let (robot, subtasks) = observation.split_at_mut(ROBOT_FEATURES);
        let part = |value: f64| value.clamp(-1.0, 2.0) as f32;
        let [x, y] =
            self.current_line.as_ref().map_or([0.0; 2], |line| [line.to_mm[0], line.to_mm[1]]);
        let (sin, cos) =
            self.current_line.as_ref().map_or((0.0, 0.0), |line| line.line.direction_rad.sin_cos());
        robot.copy_from_slice(&[
            part(x / side_mm),
            part(y / side_mm),
            cos as f32,
            sin as f32,
            f32::from(u8::from(self.current_line.is_some())),
            part(self.steps as f64 / (2 * self.subtasks()) as f64),
        ]);
        let field_mm = self.task.scanner.field_radius_mm;
        for (index, features) in subtasks.chunks_exact_mut(SUBTASK_FEATURES).enumerate() {
            let circle = &self.circles[index];
            let goes_on = !self.done[index] && self.extended(index).is_some();
            features.copy_from_slice(&[
                part(circle.center.x / side_mm),
                part(circle.center.y / side_mm),
                part(circle.radius_mm / field_mm),
                part(circle.time_s / 4.0),
                f32::from(u8::from(self.done[index])),
                f32::from(u8::from(goes_on)),
            ]);
        }
        Ok(())
    }

    fn process(&mut self, action: ScanAction) {
        self.done[action.subtask] = true;
        if action.direction == 0
            && let Some(line) = self.extended(action.subtask)
        {
            self.current.push(action.subtask);
            self.current_line = Some(line);
            return;
        }
        self.finished_s = self.total_s(self.current_line.as_ref());
        self.finished.extend(self.current_line.take());
        let turn = std::f64::consts::TAU / DIRECTIONS as f64;
        let direction_rad = match action.direction {
            // On the way to it, where there is one.
            0 => self.finished.last().map_or(0.0, |line| {
                let to = self.circles[action.subtask].center;
                (to.y - line.to_mm[1]).atan2(to.x - line.to_mm[0])
            }),
            number => (number - 1) as f64 * turn,
        };
        self.current = vec![action.subtask];
        self.current_line = self.line_of(&[action.subtask], direction_rad);
    }

    /// The line with one more subtask, in its direction.
    fn extended(&self, subtask: usize) -> Option<RoutedLine> {
        let line = self.current_line.as_ref()?;
        let mut order = self.current.clone();
        order.push(subtask);
        self.line_of(&order, line.line.direction_rad)
    }

    fn line_of(&self, order: &[usize], direction_rad: f64) -> Option<RoutedLine> {
        let circles: Vec<ScanCircle> = order.iter().map(|&index| self.circles[index]).collect();
        let router = Router::new(&self.task);
        let speeds = common_speeds(&circles, router.slowest_mm_s());
        let line = RobotLine::along(&circles, direction_rad, speeds, router.jump_s())?;
        Some(router.route(line, 0))
    }

    /// Time with `current` as the last line, s.
    fn total_s(&self, current: Option<&RoutedLine>) -> f64 {
        let Some(current) = current else { return self.finished_s };
        let router = Router::new(&self.task);
        let approach_s = self.finished.last().map_or(0.0, |before| router.ptp_s(before, current));
        self.finished_s + approach_s + current.time_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn environment(subtasks: usize) -> ScanEnvironment {
        ScanEnvironment::new(RandomLayout { subtasks, ..RandomLayout::default() }).unwrap()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]
        #[test]
        fn the_return_is_minus_the_cycle_time(
            seed in 0..1000_u64,
            directions in proptest::collection::vec(0..=DIRECTIONS, 8),
        ) {
            let mut environment = environment(8);
            environment.reset(Some(seed)).unwrap();
            let mut total = 0.0;
            for (subtask, direction) in directions.into_iter().enumerate() {
                let step = environment.step(ScanAction { subtask, direction }).unwrap();
                // A line that goes on may begin nearer to the one before it, and save time.
                prop_assert!(step.reward < 0.0 || direction == 0);
                prop_assert_eq!(step.terminated, subtask == 7);
                total += step.reward;
            }
            let progress = environment.progress();
            prop_assert!(progress.is_success && progress.done == 8);
            prop_assert!((total + progress.cycle_time_s).abs() < 1e-9);
            let lines_s: f64 = environment.lines().map(|line| line.time_s).sum();
            prop_assert!(lines_s <= progress.cycle_time_s + 1e-9);
        }
    }

    #[test]
    fn repeating_costs_and_ends_in_the_end() {
        let mut environment = environment(3);
        environment.reset(Some(1)).unwrap();
        environment.step(ScanAction { subtask: 0, direction: 1 }).unwrap();
        for k in 0..5 {
            let step = environment.step(ScanAction { subtask: 0, direction: 1 }).unwrap();
            assert!((step.reward + REPEAT_PENALTY_S).abs() < 1e-12);
            assert_eq!(step.terminated, k == 4);
        }
        assert!(!environment.progress().is_success);
        let error = environment.step(ScanAction { subtask: 1, direction: 1 }).unwrap_err();
        assert!(matches!(error, RemoteError::EpisodeOver { .. }));
    }

    #[test]
    fn actions_are_checked() {
        let environment = environment(3);
        assert!(environment.action([2, 16]).is_ok());
        for action in [[3, 0], [-1, 0], [0, 17], [0, -1]] {
            let error = environment.action(action).unwrap_err();
            assert!(matches!(error, RemoteError::Action { .. }), "{error}");
        }
    }

    #[test]
    fn a_step_before_the_first_reset_is_an_error() {
        assert!(environment(2).step(ScanAction { subtask: 0, direction: 0 }).is_err());
    }
}
