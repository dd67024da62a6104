//! One episode after another on one workpiece.

use std::sync::Arc;

use crate::action::{Action, check_finite, position_px};
use crate::workpiece::Changes;
use crate::{
    AblationError, Footprint, MAX_PULSE_RADIUS_PX, Options, Pulse, PulseOutcome, Stream, Task,
    Workpiece,
};
use lasergym_batch::{Landing, Phase};
use lasergym_geom::Bitmap;

/// A task with its settings, shared by all environments of a batch.
#[derive(Debug)]
struct Setup {
    task: Task,
    options: Options,
    /// The pristine workpiece, where every episode has the same target.
    fixed: Option<Workpiece>,
}

/// How far an episode has come.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// Machined fraction of the target, in [0, 1].
    pub machined_fraction: f64,
    /// Area machined beside the target over the area of the target.
    pub off_target_fraction: f64,
    /// Pulses fired.
    pub pulses: u32,
}

/// What one step did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Step {
    /// (remaining pixels machined − forbidden pixels machined) / 10 000.
    pub reward: f64,
    /// Whether the episode is over: complete, out of pulses, or stopped by a miss.
    pub terminated: bool,
    /// The pulse as it landed, errors included.
    pub pulse: Pulse,
}

/// An environment: a workpiece, the pulses fired at it, and the random stream that draws its
/// targets and errors.
///
/// A clone is a saved state: stepping the clone and the original with the same actions gives the
/// same results bit for bit, random errors and following episodes included.
#[derive(Debug, Clone)]
pub struct Environment {
    setup: Arc<Setup>,
    stream: Stream,
    workpiece: Workpiece,
    target_area_px: u32,
    machined: PulseOutcome,
    pulses: u32,
    last_pulse: Option<Pulse>,
    phase: Phase,
}

impl Environment {
    /// An environment before its first reset, with the random stream of seed 0.
    ///
    /// # Errors
    /// An option outside its range, a pattern that is empty or full.
    pub fn new(task: Task, options: Options) -> Result<Self, AblationError> {
        options.validate()?;
        task.validate()?;
        let fixed = task.fixed_target().map(|target| Workpiece::new(&target)).transpose()?;
        Ok(Self {
            setup: Arc::new(Setup { task, options, fixed }),
            stream: Stream::from_seed(0),
            workpiece: Workpiece::partly_machined(&Bitmap::EMPTY, &Bitmap::EMPTY),
            target_area_px: 0,
            machined: PulseOutcome::default(),
            pulses: 0,
            last_pulse: None,
            phase: Phase::NotBegun,
        })
    }

    /// Begins an episode with a new target. With `seed` the random stream starts anew, without it
    /// the stream goes on.
    pub fn reset(&mut self, seed: Option<u64>) {
        if let Some(seed) = seed {
            self.seed(seed);
        }
        if let Some(workpiece) = &self.setup.fixed {
            self.workpiece.clone_from(workpiece);
        } else {
            let target = self.setup.task.draw(&mut self.stream);
            self.workpiece = Workpiece::partly_machined(&target, &target.complement());
        }
        self.begin();
    }

    /// Starts the random stream anew.
    pub(crate) fn seed(&mut self, seed: u64) {
        self.stream = Stream::from_seed(seed);
    }

    /// Begins an episode with the given target; the random stream goes on.
    ///
    /// # Errors
    /// [`AblationError::EmptyTarget`], [`AblationError::FullTarget`]; the episode under way is kept.
    pub fn reset_to(&mut self, target: &Bitmap) -> Result<(), AblationError> {
        self.workpiece = Workpiece::new(target)?;
        self.begin();
        Ok(())
    }

    fn begin(&mut self) {
        self.target_area_px = self.workpiece.remaining().area_px();
        self.machined = PulseOutcome::default();
        self.pulses = 0;
        self.last_pulse = None;
        self.phase = Phase::Running;
    }

    /// Fires one pulse at the position of `action`.
    ///
    /// # Errors
    /// [`AblationError::ActionNotFinite`], [`AblationError::EpisodeOver`]; nothing has happened then.
    pub fn step(&mut self, action: Action) -> Result<Step, AblationError> {
        check_finite(action, 0)?;
        if self.phase != Phase::Running {
            return Err(AblationError::EpisodeOver { environment: 0 });
        }
        let pulse = self.aim(action);
        let Landing { reward, terminated } = self.land(&Footprint::of(pulse), &mut ());
        Ok(Step { reward, terminated, pulse })
    }

    /// Where the pulse of `action` will land, errors included. Each pulse aimed is to
    /// [`land`](Self::land).
    #[inline]
    pub(crate) fn aim(&mut self, action: Action) -> Pulse {
        let options = &self.setup.options;
        let mut pulse = Pulse { position: position_px(action), radius_px: options.pulse_radius_px };
        if options.pointing_error_px > 0.0 {
            pulse.position = pulse.position + self.stream.displacement(options.pointing_error_px);
        }
        if options.radius_error > 0.0 {
            let factor = 1.0 + options.radius_error * self.stream.normal();
            pulse.radius_px =
                (pulse.radius_px * factor).clamp(f64::MIN_POSITIVE, MAX_PULSE_RADIUS_PX);
        }
        self.last_pulse = Some(pulse);
        pulse
    }

    /// Machines the footprint of an aimed pulse; `changes` learns what it changes. The episode
    /// must be running.
    #[inline]
    pub(crate) fn land(&mut self, footprint: &Footprint, changes: &mut impl Changes) -> Landing {
        let outcome = self.workpiece.pulse_onto(footprint, changes);
        self.machined.hit_px += outcome.hit_px;
        self.machined.miss_px += outcome.miss_px;
        self.pulses += 1;
        let options = &self.setup.options;
        let terminated = self.is_success()
            || self.pulses >= options.max_pulses
            || (options.stop_on_miss && outcome.hit_px == 0);
        if terminated {
            self.phase = Phase::Over;
        }
        Landing { reward: outcome.reward(), terminated }
    }

    /// Ends the episode without a further pulse, as a time limit does.
    pub(crate) fn end(&mut self) {
        self.phase = Phase::Over;
    }

    /// How far the episode has come.
    #[must_use]
    pub fn progress(&self) -> Progress {
        let area_px = f64::from(self.target_area_px.max(1));
        Progress {
            machined_fraction: f64::from(self.machined.hit_px) / area_px,
            off_target_fraction: f64::from(self.machined.miss_px) / area_px,
            pulses: self.pulses,
        }
    }

    /// Sum of the rewards since the episode began: (hits − misses) / 10 000.
    #[must_use]
    pub fn episode_return(&self) -> f64 {
        self.machined.reward()
    }

    /// Whether the machined fraction has reached `completion`.
    #[must_use]
    pub fn is_success(&self) -> bool {
        f64::from(self.machined.hit_px)
            >= self.setup.options.completion * f64::from(self.target_area_px.max(1))
    }

    /// The last pulse of the episode as it landed, errors included.
    #[must_use]
    pub fn last_pulse(&self) -> Option<Pulse> {
        self.last_pulse
    }

    /// The workpiece as it is now.
    #[must_use]
    pub fn workpiece(&self) -> &Workpiece {
        &self.workpiece
    }

    /// Pulses that the budget still allows.
    #[must_use]
    pub fn pulses_left(&self) -> u32 {
        self.setup.options.max_pulses.saturating_sub(self.pulses)
    }

    /// The settings.
    #[must_use]
    pub fn options(&self) -> &Options {
        &self.setup.options
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::star;
    use proptest::prelude::*;

    fn task() -> impl Strategy<Value = Task> {
        prop_oneof![
            Just(Task::Star),
            Just(Task::RotatedStar),
            Just(Task::RandomShape),
            Just(Task::Pattern(Box::new(star(17.0)))),
        ]
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        /// Return = hits − misses; a clone replays the original, the next episode included.
        #[test]
        fn return_is_conserved_and_clones_replay(
            task in task(),
            seed: u64,
            pointing_error_px in prop_oneof![Just(0.0), 0.0..5.0],
            radius_error in prop_oneof![Just(0.0), 0.0..0.3],
            actions in proptest::collection::vec([-1.3_f32..1.3, -1.3_f32..1.3], 60),
        ) {
            let options =
                Options { pointing_error_px, radius_error, max_pulses: 25, ..Options::default() };
            let mut environment = Environment::new(task, options).unwrap();
            environment.reset(Some(seed));
            let target = environment.workpiece().remaining().clone();
            let mut twin = environment.clone();
            let mut sum = 0.0;
            let mut first_episode = true;
            for action in actions {
                let step = environment.step(action).unwrap();
                prop_assert_eq!(step, twin.step(action).unwrap());
                sum += step.reward;
                if step.terminated {
                    prop_assert_eq!(environment.step(action), Err(AblationError::EpisodeOver { environment: 0 }));
                    if first_episode {
                        let hits = target.area_px() - environment.workpiece().remaining().area_px();
                        let misses = 10_000 - target.area_px() - environment.workpiece().forbidden().area_px();
                        prop_assert!((sum - (f64::from(hits) - f64::from(misses)) / 1e4).abs() < 1e-12);
                        prop_assert!((sum - environment.episode_return()).abs() < 1e-12);
                        first_episode = false;
                    }
                    environment.reset(None);
                    twin.reset(None);
                    prop_assert_eq!(environment.workpiece(), twin.workpiece());
                }
            }
        }
    }

    #[test]
    fn actions_are_clipped_and_must_be_finite() {
        let mut environment = Environment::new(Task::Star, Options::default()).unwrap();
        assert_eq!(environment.step([0.0; 2]), Err(AblationError::EpisodeOver { environment: 0 }));
        environment.reset(Some(1));
        let before = environment.workpiece().clone();
        for bad in [[f32::NAN, 0.0], [0.0, f32::INFINITY]] {
            assert!(matches!(environment.step(bad), Err(AblationError::ActionNotFinite { .. })));
        }
        assert_eq!(environment.workpiece(), &before);
        let mut twin = environment.clone();
        assert_eq!(environment.step([7.0, -7.0]), twin.step([1.0, -1.0]));
    }

    #[test]
    fn episodes_end_when_complete_out_of_pulses_or_missed() {
        let run = |options: Options, action: Action| {
            let mut environment = Environment::new(Task::Star, options).unwrap();
            environment.reset(None);
            for steps in 1.. {
                if environment.step(action).unwrap().terminated {
                    return (steps, environment.is_success());
                }
            }
            unreachable!()
        };
        let corner = [-1.0, -1.0];
        assert_eq!(run(Options { max_pulses: 3, ..Options::default() }, corner), (3, false));
        assert_eq!(run(Options { stop_on_miss: true, ..Options::default() }, corner), (1, false));
        assert_eq!(run(Options { completion: 0.05, ..Options::default() }, [0.0; 2]), (1, true));
    }
}
