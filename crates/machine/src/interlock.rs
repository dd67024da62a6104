//! The only way to the laser: armed for one pulse, and only where the stage has confirmed to be.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use lasergym_geom::Point;

use crate::halt::Halt;
use crate::{Device, Fault, FaultKind, Laser};

/// What the laser may do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum InterlockState {
    /// Nothing: the stage moves, or has not said where it is.
    Safe,
    /// Be armed: the stage rests where the pulse goes.
    InPosition,
    /// Fire: for as long as one pulse takes.
    Armed,
    /// Nothing any more.
    Tripped,
}

/// Owns the laser and fires it only in position.
#[derive(Debug)]
pub(crate) struct Interlock<L> {
    laser: L,
    state: InterlockState,
    dry_run: bool,
    tolerance_um: f64,
    stop: Arc<AtomicBool>,
}

impl<L: Laser<Error = Fault>> Interlock<L> {
    /// An interlock that is safe. A dry run never arms the laser; `stop` keeps it from firing.
    pub(crate) fn new(laser: L, tolerance_um: f64, dry_run: bool, stop: Arc<AtomicBool>) -> Self {
        Self { laser, state: InterlockState::Safe, dry_run, tolerance_um, stop }
    }

    /// Disarms the laser, whatever state it was left in.
    pub(crate) fn make_safe(&mut self) -> Result<(), Fault> {
        self.leave();
        self.laser.disarm()
    }

    /// The stage is about to move.
    pub(crate) fn leave(&mut self) {
        if self.state != InterlockState::Tripped {
            self.state = InterlockState::Safe;
        }
    }

    /// Whether the stage, which says that it is at `actual_um`, is within the tolerance of
    /// `wanted_um`; the laser may then be fired once.
    pub(crate) fn confirm(&mut self, wanted_um: Point, actual_um: Point) -> Result<bool, Fault> {
        self.leave();
        let Point { x, y } = actual_um;
        if !(x.is_finite() && y.is_finite()) {
            let message = format!("it says that it is at ({x}, {y}) µm");
            return Err(Fault::new(Device::Stage, FaultKind::NotFinite, message));
        }
        let within = actual_um.distance(wanted_um) <= self.tolerance_um;
        if within && self.state == InterlockState::Safe {
            self.state = InterlockState::InPosition;
        }
        Ok(within)
    }

    /// Whether the user wants to stop.
    pub(crate) fn check_stop(&self) -> Result<(), Halt> {
        if self.stop.load(Ordering::SeqCst) { Err(Halt::Interrupted) } else { Ok(()) }
    }

    /// Arms the laser, fires one pulse and disarms it.
    pub(crate) fn fire(&mut self) -> Result<(), Halt> {
        if self.state != InterlockState::InPosition {
            let message = format!("it was to fire while the interlock is {:?}", self.state);
            return Err(Fault::new(Device::Laser, FaultKind::Interlock, message).into());
        }
        self.state = InterlockState::Safe;
        self.check_stop()?;
        if self.dry_run {
            return Ok(());
        }
        self.state = InterlockState::Armed;
        let fired = self.fire_armed();
        let disarmed = self.laser.disarm();
        self.state = InterlockState::Safe;
        fired?;
        Ok(disarmed?)
    }

    fn fire_armed(&mut self) -> Result<(), Halt> {
        self.laser.arm()?;
        self.check_stop()?;
        Ok(self.laser.fire()?)
    }

    /// Disarms the laser for good.
    pub(crate) fn trip(&mut self) -> Result<(), Fault> {
        self.state = InterlockState::Tripped;
        self.laser.disarm()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Counts, and fails where it is told to.
    #[derive(Debug, Default)]
    struct Counter {
        calls: Vec<&'static str>,
        fails: &'static str,
    }

    impl Counter {
        fn call(&mut self, name: &'static str) -> Result<(), Fault> {
            self.calls.push(name);
            if self.fails == name {
                return Err(Fault::new(Device::Laser, FaultKind::Other, name));
            }
            Ok(())
        }
    }

    impl Laser for Counter {
        type Error = Fault;
        fn arm(&mut self) -> Result<(), Fault> {
            self.call("arm")
        }
        fn fire(&mut self) -> Result<(), Fault> {
            self.call("fire")
        }
        fn disarm(&mut self) -> Result<(), Fault> {
            self.call("disarm")
        }
    }

    const HERE: Point = Point::new(20.0, 30.0);

    fn interlock(fails: &'static str, dry_run: bool) -> Interlock<Counter> {
        let laser = Counter { fails, ..Counter::default() };
        Interlock::new(laser, 0.5, dry_run, Arc::default())
    }

    #[test]
    fn one_confirmed_position_is_one_pulse() {
        let mut interlock = interlock("", false);
        assert!(interlock.fire().is_err());
        assert!(interlock.confirm(HERE, HERE + Point::new(0.3, 0.4)).unwrap());
        assert!(interlock.fire().is_ok());
        assert!(interlock.fire().is_err());
        assert_eq!(interlock.laser.calls, ["arm", "fire", "disarm"]);
    }

    #[test]
    fn nothing_fires_out_of_tolerance_after_a_move_or_where_nobody_knows() {
        let mut interlock = interlock("", false);
        assert!(!interlock.confirm(HERE, HERE + Point::new(0.5, 0.1)).unwrap());
        assert!(interlock.fire().is_err());
        assert!(interlock.confirm(HERE, HERE).unwrap());
        interlock.leave();
        assert!(interlock.fire().is_err());
        assert!(interlock.confirm(HERE, HERE).unwrap());
        let error = interlock.confirm(HERE, Point::new(f64::NAN, 0.0)).unwrap_err();
        assert_eq!(error.kind, FaultKind::NotFinite);
        assert!(interlock.fire().is_err());
        assert!(interlock.laser.calls.is_empty());
    }

    #[test]
    fn every_failure_ends_with_the_laser_disarmed() {
        for (fails, calls) in [
            ("arm", &["arm", "disarm"][..]),
            ("fire", &["arm", "fire", "disarm"]),
            ("disarm", &["arm", "fire", "disarm"]),
        ] {
            let mut interlock = interlock(fails, false);
            assert!(interlock.confirm(HERE, HERE).unwrap());
            assert!(matches!(interlock.fire(), Err(Halt::Fault(_))));
            assert_eq!(interlock.laser.calls, calls);
        }
    }

    #[test]
    fn a_dry_run_never_arms_and_a_tripped_interlock_never_fires() {
        let mut dry = interlock("", true);
        assert!(dry.confirm(HERE, HERE).unwrap());
        assert!(dry.fire().is_ok());
        assert!(dry.laser.calls.is_empty());
        let mut tripped = interlock("", false);
        tripped.trip().unwrap();
        assert!(tripped.confirm(HERE, HERE).unwrap());
        assert!(tripped.fire().is_err());
        assert_eq!(tripped.laser.calls, ["disarm"]);
    }

    #[test]
    fn a_user_who_wants_to_stop_keeps_the_laser_off() {
        let mut interlock = interlock("", false);
        assert!(interlock.confirm(HERE, HERE).unwrap());
        interlock.stop.store(true, Ordering::SeqCst);
        assert!(matches!(interlock.fire(), Err(Halt::Interrupted)));
        assert!(interlock.laser.calls.is_empty());
    }
}
