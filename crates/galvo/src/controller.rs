//! Runs a program as a controller does: delays, polylines, sky writing.

use lasergym_geom::Point;

use crate::delays::{SkyWriting, SkyWritingMode};
use crate::player::{Player, PulseLanding, Purpose, TimeSplit};
use crate::program::{ProgramSettings, ProgramStep};
use crate::{GalvoError, ScanHead};

/// Most pulses of a program.
pub const MAX_PROGRAM_PULSES: u64 = crate::player::MAX_PULSES;

/// One end of a stroke as it was drawn, without run-in and run-out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StrokeEnd {
    /// Number of the stroke, from 0.
    pub stroke: u64,
    /// Where it was drawn, µm.
    pub at_um: Point,
    /// Direction of the stroke there, of length 1.
    pub direction: Point,
    /// Speed there, m/s.
    pub speed_m_s: f64,
    /// Crater diameter by which the stroke was shortened, µm.
    pub beam_um: f64,
}

/// Watches a program run.
pub trait Observer {
    /// A stroke begins.
    fn stroke_begins(&mut self, _start: &StrokeEnd) {}
    /// A stroke has a corner at `at_um`, which a lagging beam rounds off within about `reach_um`.
    fn corner(&mut self, _stroke: u64, _at_um: Point, _reach_um: f64) {}
    /// The commands of a stroke have ended; its last pulses may still come.
    fn stroke_ends(&mut self, _end: &StrokeEnd) {}
    /// A pulse lands. Pulses come in order, stroke by stroke.
    fn pulse(&mut self, _pulse: &PulseLanding) {}
}

#[derive(Debug, Clone, Copy)]
struct Mark {
    to_um: Point,
    speed_m_s: f64,
    lit: bool,
}

/// A controller with its head.
#[derive(Debug)]
pub struct ProgramRun<'a, O> {
    head: &'a ScanHead,
    player: Player<'a>,
    observer: O,
    settings: ProgramSettings,
    /// A jump whose end may still move, with sky writing.
    jump: Option<Point>,
    /// The mark that is next, held back until it is known what follows.
    held: Option<Mark>,
    /// Whether the held mark continues a stroke.
    in_stroke: bool,
    lit: bool,
    /// Where the drawn path is, µm.
    drawn_um: Point,
    stroke: u64,
    pulses: u64,
    started: bool,
}

impl<'a, O: Observer> ProgramRun<'a, O> {
    /// A program begins, with the head at rest in the middle of its field. The first jump takes no
    /// time.
    #[must_use]
    pub fn new(head: &'a ScanHead, observer: O) -> Self {
        Self {
            head,
            player: Player::new(head, Point::default()),
            observer,
            settings: ProgramSettings::of_head(head),
            jump: None,
            held: None,
            in_stroke: false,
            lit: false,
            drawn_um: Point::default(),
            stroke: 0,
            pulses: 0,
            started: false,
        }
    }

    /// Runs one step. Marks are held back by one step.
    ///
    /// # Errors
    /// [`GalvoError::InvalidOption`] for settings or a speed out of range,
    /// [`GalvoError::OutsideField`] for a place beyond the field, [`GalvoError::TooManyPulses`] above
    /// [`MAX_PROGRAM_PULSES`].
    pub fn step(&mut self, step: &ProgramStep) -> Result<(), GalvoError> {
        match *step {
            ProgramStep::Settings(settings) => {
                settings.validate()?;
                self.end_stroke();
                self.settings = settings;
                self.player.hold_at_least(-settings.delays.laser_off_us);
            }
            ProgramStep::Jump { to_um } => {
                self.check(to_um)?;
                self.end_stroke();
                self.jump = Some(to_um);
            }
            ProgramStep::Dwell { duration_us } => {
                crate::error::check_option(
                    "duration_us",
                    duration_us,
                    (0.0..=1e9).contains(&duration_us),
                    "in [0, 1e9] µs",
                )?;
                self.end_stroke();
                self.arrive(None);
                self.player.wait(duration_us);
            }
            ProgramStep::Layer { .. } => self.end_stroke(),
            ProgramStep::Mark { to_um, speed_m_s, lit } => {
                self.check(to_um)?;
                crate::program::check_speed("speed_m_s", speed_m_s)?;
                self.add(Mark { to_um, speed_m_s, lit });
            }
        }
        self.hand_out()
    }

    /// Ends the program: the last pulses land. Returns the observer, where the time went, and the
    /// number of pulses.
    ///
    /// # Errors
    /// As [`ProgramRun::step`].
    pub fn finish(mut self) -> Result<(O, TimeSplit, u64), GalvoError> {
        self.end_stroke();
        self.arrive(None);
        let split = self.player.split();
        let (observer, pulses) = (&mut self.observer, &mut self.pulses);
        self.player.finish(&mut |pulse| {
            *pulses += 1;
            observer.pulse(pulse);
        });
        Ok((self.observer, split, self.pulses))
    }

    fn check(&self, place: Point) -> Result<(), GalvoError> {
        if self.head.field.contains(place) {
            return Ok(());
        }
        Err(GalvoError::OutsideField {
            vector: self.stroke + 1,
            x_um: place.x,
            y_um: place.y,
            half_um: self.head.field.half_um(),
        })
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

    fn sky(&self) -> Option<&'a SkyWriting> {
        self.head.controller.sky_writing.as_ref()
    }

    fn add(&mut self, mark: Mark) {
        let from = self.held.map_or(self.jump.unwrap_or(self.drawn_um), |held| held.to_um);
        if from.distance(mark.to_um) <= 0.0 {
            return;
        }
        if let Some(held) = self.held.take() {
            let direction = (mark.to_um - held.to_um).normalized();
            self.run(held, Some((mark, direction)));
        }
        self.held = Some(mark);
    }

    fn end_stroke(&mut self) {
        if let Some(held) = self.held.take() {
            self.run(held, None);
        }
    }

    /// Carries out the jump that is due; with sky writing to the run-in of a mark at this velocity.
    fn arrive(&mut self, velocity: Option<Point>) {
        let Some(to_um) = self.jump.take() else { return };
        self.drawn_um = to_um;
        let lead = match (self.sky(), velocity) {
            (Some(sky), Some(velocity)) if sky.mode != SkyWritingMode::Retrace => {
                velocity * sky.run_in_us()
            }
            _ => Point::default(),
        };
        self.jump_to(to_um - lead);
    }

    fn jump_to(&mut self, place: Point) {
        if !self.started {
            self.player.set_start(place);
            self.started = true;
            return;
        }
        let length_um = self.player.at_um().distance(place);
        if length_um > 0.0 {
            let speed = self.settings.jump_speed_m_s;
            self.player.advance(place, length_um / speed, Purpose::Jump);
            self.player.wait(self.settings.delays.after_jump_us(length_um));
        }
    }

    /// Runs a mark; `next` is the mark that continues the stroke, with its direction.
    fn run(&mut self, mark: Mark, next: Option<(Mark, Point)>) {
        let start = self.jump.unwrap_or(self.drawn_um);
        let direction = (mark.to_um - start).normalized();
        let velocity = direction * mark.speed_m_s;
        let first = !self.in_stroke;
        if first {
            self.arrive(Some(velocity));
            self.started = true;
            self.observer.stroke_begins(&self.end_of(
                self.drawn(start + direction * self.settings.run_in_um, direction),
                direction,
                mark.speed_m_s,
            ));
            self.run_in(start, velocity);
        }
        self.switch(mark, first);
        let before_um = if first { self.settings.run_in_um } else { 0.0 };
        let after_um = if next.is_none() { self.settings.run_out_um } else { 0.0 };
        self.travel(mark, start, before_um, after_um);
        self.drawn_um = mark.to_um;
        match next {
            Some((next, onward)) => self.turn(mark, direction, next, onward),
            None => self.leave(mark, direction),
        }
    }

    /// Run-in of sky writing before a mark that starts at `start`.
    fn run_in(&mut self, start: Point, velocity: Point) {
        let Some(sky) = self.sky() else { return };
        let run_in_us = sky.run_in_us();
        if sky.mode == SkyWritingMode::Retrace {
            self.player.advance(start - velocity * run_in_us, run_in_us, Purpose::RunIn);
        }
        self.player.advance(start, run_in_us, Purpose::RunIn);
    }

    /// Run-out of sky writing behind a mark that ends at `end`.
    fn run_out(&mut self, end: Point, velocity: Point) {
        let Some(sky) = self.sky() else { return };
        let run_out_us = sky.run_out_us();
        self.player.advance(end + velocity * run_out_us, run_out_us, Purpose::RunIn);
        if sky.mode == SkyWritingMode::Retrace {
            self.player.advance(end, run_out_us, Purpose::RunIn);
        }
    }

    /// Switches the laser as the mark that is about to move asks for.
    fn switch(&mut self, mark: Mark, first: bool) {
        let clock_us = self.player.clock_us();
        if mark.lit && (first || !self.lit) {
            let on_us = match self.sky() {
                Some(sky) => sky.timelag_us + sky.laser_on_shift_us,
                None => self.settings.delays.laser_on_us,
            };
            let period_us = 1e6 / self.settings.pulse_rate_hz;
            self.player.open_gate(clock_us + on_us, period_us, self.stroke);
        } else if self.lit && !mark.lit {
            self.switch_off();
        }
        self.lit = mark.lit;
    }

    fn switch_off(&mut self) {
        let off_us = self.sky().map_or(self.settings.delays.laser_off_us, |sky| sky.timelag_us);
        self.player.close_gate(self.player.clock_us() + off_us);
        self.lit = false;
    }

    /// Moves along a mark; its first `before_um` and last `after_um` are run-in and run-out.
    fn travel(&mut self, mark: Mark, start: Point, before_um: f64, after_um: f64) {
        let length_um = start.distance(mark.to_um);
        let direction = (mark.to_um - start).normalized();
        let before_um = before_um.min(length_um);
        let after_um = after_um.min(length_um - before_um);
        let main =
            if mark.lit || before_um + after_um > 0.0 { Purpose::Mark } else { Purpose::RunIn };
        let middle_um = length_um - before_um - after_um;
        let pieces = [
            (start + direction * before_um, before_um, Purpose::RunIn),
            (start + direction * (before_um + middle_um), middle_um, main),
            (mark.to_um, after_um, Purpose::RunIn),
        ];
        for (to_um, piece_um, purpose) in pieces {
            self.player.advance(to_um, piece_um / mark.speed_m_s, purpose);
        }
    }

    fn turn(&mut self, mark: Mark, direction: Point, next: Mark, onward: Point) {
        let cosine = direction.x * onward.x + direction.y * onward.y;
        self.in_stroke = true;
        let corner = mark.to_um;
        match self.sky() {
            Some(sky) if sky.breaks_at(cosine) => {
                self.leave(mark, direction);
                let velocity = onward * next.speed_m_s;
                if sky.mode != SkyWritingMode::Retrace {
                    self.jump_to(corner - velocity * sky.run_in_us());
                }
                self.observer.stroke_begins(&self.end_of(corner, onward, next.speed_m_s));
                self.run_in(corner, velocity);
                self.in_stroke = true;
            }
            _ => {
                let lag_us = self.head.x.lag_us().max(self.head.y.lag_us());
                self.observer.corner(self.stroke, corner, mark.speed_m_s * lag_us);
                self.player.wait(self.settings.delays.at_corner_us(cosine));
            }
        }
    }

    /// The stroke ends with the mark that has just moved.
    fn leave(&mut self, mark: Mark, direction: Point) {
        if self.lit {
            self.switch_off();
        }
        let drawn = self.drawn(mark.to_um - direction * self.settings.run_out_um, direction);
        self.observer.stroke_ends(&self.end_of(drawn, direction, mark.speed_m_s));
        self.run_out(mark.to_um, direction * mark.speed_m_s);
        if self.sky().is_none() {
            self.player.wait(self.settings.delays.mark_us);
        }
        self.in_stroke = false;
        self.stroke += 1;
    }

    /// Where a place that is commanded on a stroke was drawn.
    fn drawn(&self, commanded_um: Point, direction: Point) -> Point {
        commanded_um - Point::new(-direction.y, direction.x) * self.settings.lateral_um
    }

    fn end_of(&self, at_um: Point, direction: Point, speed_m_s: f64) -> StrokeEnd {
        let beam_um = self.settings.beam_um;
        StrokeEnd { stroke: self.stroke, at_um, direction, speed_m_s, beam_um }
    }
}
