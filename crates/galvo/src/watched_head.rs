//! A head that carries out commands while somebody watches.

use lasergym_geom::Point;

use crate::head_command::{CommandSink, HeadCommand, StrokeEnd};
use crate::player::{MAX_PULSES, Player, PulseLanding, TimeSplit};
use crate::{GalvoError, ScanHead};

/// Most pulses of a program.
pub const MAX_PROGRAM_PULSES: u64 = MAX_PULSES;

/// Watches a program run.
pub trait Observer {
    /// A stroke begins.
    fn stroke_begins(&mut self, _start: &StrokeEnd) {}
    /// A stroke will have a corner at `at_um`, which a lagging beam rounds off within about `reach_um`;
    /// the vector that leads to it begins.
    fn corner(&mut self, _stroke: u64, _at_um: Point, _reach_um: f64) {}
    /// The commands of a stroke have ended; its last pulses may still come.
    fn stroke_ends(&mut self, _end: &StrokeEnd) {}
    /// A pulse lands. Pulses come in order, stroke by stroke.
    fn pulse(&mut self, _pulse: &PulseLanding) {}
}

/// A head and its observer.
#[derive(Debug)]
pub struct WatchedHead<'a, O> {
    player: Player<'a>,
    observer: O,
    pulses: u64,
}

impl<'a, O: Observer> WatchedHead<'a, O> {
    /// A head at rest in the middle of its field.
    #[must_use]
    pub fn new(head: &'a ScanHead, observer: O) -> Self {
        Self { player: Player::new(head, Point::default()), observer, pulses: 0 }
    }

    /// Lets the last pulses land. Returns the observer, where the time went, and the number of pulses.
    pub fn finish(mut self) -> (O, TimeSplit, u64) {
        let split = self.player.split();
        let (observer, pulses) = (&mut self.observer, &mut self.pulses);
        self.player.finish(&mut |pulse| {
            *pulses += 1;
            observer.pulse(pulse);
        });
        (self.observer, split, self.pulses)
    }

    fn hand_out(&mut self) -> Result<(), GalvoError> {
        let (observer, pulses) = (&mut self.observer, &mut self.pulses);
        self.player.fire(&mut |pulse| {
            *pulses += 1;
            observer.pulse(pulse);
        });
        if *pulses > MAX_PROGRAM_PULSES {
            return Err(GalvoError::TooManyPulses { limit: MAX_PROGRAM_PULSES });
        }
        Ok(())
    }
}

impl<O: Observer> CommandSink for WatchedHead<'_, O> {
    fn take(&mut self, command: &HeadCommand) -> Result<(), GalvoError> {
        let clock_us = self.player.clock_us();
        match *command {
            HeadCommand::Rest { at_um } => self.player.set_start(at_um),
            HeadCommand::Move { to_um, duration_us, purpose } => {
                self.player.advance(to_um, duration_us, purpose);
                return self.hand_out();
            }
            HeadCommand::LaserOn { after_us, pulse_rate_hz, stroke } => {
                self.player.open_gate(clock_us + after_us, 1e6 / pulse_rate_hz, stroke);
            }
            HeadCommand::LaserOff { after_us } => self.player.close_gate(clock_us + after_us),
            HeadCommand::StrokeBegins(start) => self.observer.stroke_begins(&start),
            HeadCommand::Corner { stroke, at_um, reach_um } => {
                self.observer.corner(stroke, at_um, reach_um);
            }
            HeadCommand::StrokeEnds(end) => self.observer.stroke_ends(&end),
            HeadCommand::Layer { .. } => {}
        }
        Ok(())
    }

    fn hold_at_least(&mut self, hold_us: f64) {
        self.player.hold_at_least(hold_us);
    }
}
