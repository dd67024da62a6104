//! A plan for the rest of a job, kept good while the job goes on.

use lasergym_geom::Point;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;

use crate::{Job, PlanError};

use super::cover::Cover;
use super::lattice::{Lattice, Place};
use super::metropolis::{BestPlaces, MoveOdds, NormalQuantiles, Walk};
use super::options::Ramp;
use super::planner::NARROW_RADIUS_PX;

/// Temperature of the moves, px: hotter than [`crate::AnnealOptions`] has it, since few moves have
/// to get somewhere.
const TEMPERATURE_PX: Ramp = Ramp { from: 0.5, to: 0.25 };

/// Standard deviation of a move, px.
const STEP_PX: Ramp = Ramp { from: 0.9, to: 0.3 };

/// Temperatures that a refinement goes through.
const ROUNDS: u32 = 6;

/// The pulses that are still to come, and what they gain together.
///
/// A few thousand Metropolis moves, a fraction of a millisecond, follow a pulse that landed
/// elsewhere than planned, or tell what a candidate for the next pulse would cost in the end.
#[derive(Debug, Clone)]
pub struct Completion {
    lattice: Lattice,
    walk: Walk<u64>,
    normal: NormalQuantiles,
    generator: Pcg64Mcg,
}

impl Completion {
    /// The completion of `job` by pulses at `positions`, moved to the nearest places of a lattice of
    /// 1/16 px. `seed` is that of the moves.
    ///
    /// # Errors
    /// [`PlanError::InvalidOption`] for pulses of a radius above 24 px.
    pub fn new(job: &Job, positions: &[Point], seed: u64) -> Result<Self, PlanError> {
        if job.pulse_radius_px() > NARROW_RADIUS_PX {
            return Err(PlanError::InvalidOption {
                name: "pulse_radius_px",
                value: job.pulse_radius_px().to_string(),
                expected: "at most 24 px for completions",
            });
        }
        let lattice = Lattice::new(job.pulse_radius_px());
        let mut walk = Walk {
            cover: Cover::<u64>::new(job.workpiece(), &lattice, positions.len()),
            places: positions.iter().map(|&position| Place::near(position)).collect(),
            gain_px: 0,
        };
        for &place in &walk.places {
            walk.gain_px += walk.cover.fire(place, |_, _, _| ());
        }
        let (normal, generator) = (NormalQuantiles::new(), Pcg64Mcg::seed_from_u64(seed));
        Ok(Self { lattice, walk, normal, generator })
    }

    /// The pulses, px, as actions reach them.
    #[must_use]
    pub fn positions(&self) -> Vec<Point> {
        self.lattice.positions(&self.walk.places)
    }

    /// Hits − misses of all of them together, px.
    #[must_use]
    pub fn gain_px(&self) -> i32 {
        self.walk.gain_px
    }

    /// Does `moves` Metropolis moves and keeps the best plan seen, which is never worse.
    pub fn refine(&mut self, moves: u64) {
        self.refine_first(self.walk.places.len(), moves);
    }

    /// What the whole plan gains, px, when the pulse nearest to `position` lands there and the others
    /// give way within `moves` moves; 0 where there is no pulse.
    #[must_use]
    pub fn value_px(&self, position: Point, moves: u64) -> i32 {
        let to = Place::near(position);
        let Some(nearest) = self.nearest(to) else { return 0 };
        let mut other = self.clone();
        let last = other.walk.places.len() - 1;
        other.walk.places.swap(nearest, last);
        let from = std::mem::replace(&mut other.walk.places[last], to);
        other.walk.gain_px += other.walk.cover.lift(from, |_, _, _| ());
        other.walk.gain_px += other.walk.cover.fire(to, |_, _, _| ());
        other.refine_first(last, moves);
        other.gain_px()
    }

    /// The pulse nearest to `position`, px.
    #[must_use]
    pub fn nearest_position(&self, position: Point) -> Option<Point> {
        let nearest = self.nearest(Place::near(position))?;
        Some(self.lattice.position(self.walk.places[nearest]))
    }

    fn nearest(&self, to: Place) -> Option<usize> {
        let distance = |place: &Place| (place.x - to.x).pow(2) + (place.y - to.y).pow(2);
        let places = self.walk.places.iter().enumerate();
        places.min_by_key(|(_, place)| distance(place)).map(|(index, _)| index)
    }

    /// Refines the first `free` pulses; the others stay.
    fn refine_first(&mut self, free: usize, moves: u64) {
        if free == 0 || moves == 0 {
            return;
        }
        let walk = &mut self.walk;
        let mut best = BestPlaces { gain_px: walk.gain_px, places: walk.places.clone() };
        for round in 0..ROUNDS {
            let fraction = f64::from(round) / f64::from(ROUNDS - 1);
            let (temperature_px, step_px) = (TEMPERATURE_PX.at(fraction), STEP_PX.at(fraction));
            let odds = MoveOdds::new(&self.normal, temperature_px, step_px, 0.0);
            let moves = moves.div_ceil(u64::from(ROUNDS));
            walk.metropolis(moves, free, &odds, &mut self.generator, &mut best);
        }
        if best.places != walk.places {
            for &place in &walk.places {
                walk.cover.lift(place, |_, _, _| ());
            }
            for &place in &best.places {
                walk.cover.fire(place, |_, _, _| ());
            }
            (walk.places, walk.gain_px) = (best.places, best.gain_px);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Greedy, Planner};
    use lasergym_ablation::{Workpiece, star};
    use proptest::prelude::*;

    fn completion(pulses: usize, seed: u64) -> (Job, Completion) {
        let job = Job::new(Workpiece::new(&star(0.0)).unwrap(), 9.0, pulses).unwrap();
        let plan = Greedy::default().plan_to_end(&job).unwrap();
        let completion = Completion::new(&job, &plan.positions, seed).unwrap();
        (job, completion)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(12))]
        #[test]
        fn the_gain_is_what_the_process_says_and_never_falls(
            seed in 0_u64..1000, moves in 0_u64..5000,
        ) {
            let (job, mut completion) = completion(30, seed);
            let before_px = completion.gain_px();
            completion.refine(moves);
            prop_assert!(completion.gain_px() >= before_px);
            let outcome = job.outcome(&completion.positions());
            prop_assert_eq!(outcome.gain_px(), completion.gain_px());
        }

        #[test]
        fn a_pulse_of_the_plan_is_worth_the_plan_and_others_at_most_a_little_more(
            x in 20.0..80.0, y in 30.0..80.0,
        ) {
            let (_, mut completion) = completion(40, 1);
            completion.refine(100_000);
            let near = completion.nearest_position(Point::new(x, y)).unwrap();
            prop_assert_eq!(completion.value_px(near, 0), completion.gain_px());
            prop_assert!(completion.value_px(near, 2000) >= completion.gain_px());
            prop_assert!(completion.value_px(Point::new(0.0, 0.0), 500) < completion.gain_px());
        }
    }

    #[test]
    fn wide_pulses_are_refused() {
        let job = Job::new(Workpiece::new(&star(0.0)).unwrap(), 30.0, 3).unwrap();
        let error = Completion::new(&job, &[], 0).unwrap_err();
        assert!(matches!(error, PlanError::InvalidOption { name: "pulse_radius_px", .. }));
    }

    #[test]
    fn a_plan_without_pulses_stays_empty() {
        let job = Job::new(Workpiece::new(&star(0.0)).unwrap(), 9.0, 3).unwrap();
        let mut empty = Completion::new(&job, &[], 0).unwrap();
        empty.refine(1000);
        assert_eq!((empty.gain_px(), empty.positions().len()), (0, 0));
        assert_eq!(empty.value_px(Point::new(50.0, 50.0), 1000), 0);
    }
}
