//! Runs a program as a controller does: delays, polylines, sky writing.

use lasergym_geom::Point;

use crate::delays::{SkyWriting, SkyWritingMode};
use crate::head_command::{CommandSink, HeadCommand, StrokeEnd};
use crate::player::{Purpose, TimeSplit};
use crate::program::{ProgramSettings, ProgramStep};
use crate::watched_head::{Observer, WatchedHead};
use crate::{GalvoError, ScanHead};

#[derive(Debug, Clone, Copy)]
struct Mark {
    to_um: Point,
    speed_m_s: f64,
    lit: bool,
}

/// A controller that runs a program: steps in, commands for a head out.
#[derive(Debug)]
pub struct ProgramRun<'a, C> {
    head: &'a ScanHead,
    sink: C,
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
    /// Where the last command leads, µm.
    at_um: Point,
    stroke: u64,
    started: bool,
}

impl<'a, O: Observer> ProgramRun<'a, WatchedHead<'a, O>> {
    /// A program begins on a head that rests in the middle of its field and is watched. The first jump
    /// takes no time, nor does a dwell before it.
    #[must_use]
    pub fn new(head: &'a ScanHead, observer: O) -> Self {
        Self::onto(head, WatchedHead::new(head, observer))
    }

    /// Ends the program: the last pulses land. Returns the observer, where the time went, and the
    /// number of pulses.
    ///
    /// # Errors
    /// As [`ProgramRun::step`].
    pub fn finish(self) -> Result<(O, TimeSplit, u64), GalvoError> {
        Ok(self.end()?.finish())
    }
}

impl<'a, C: CommandSink> ProgramRun<'a, C> {
    /// A program begins whose commands go to `sink`.
    #[must_use]
    pub fn onto(head: &'a ScanHead, mut sink: C) -> Self {
        let settings = ProgramSettings::of_head(head);
        sink.hold_at_least(hold_us(head, &settings));
        Self {
            head,
            sink,
            settings,
            jump: None,
            held: None,
            in_stroke: false,
            lit: false,
            drawn_um: Point::default(),
            at_um: Point::default(),
            stroke: 0,
            started: false,
        }
    }

    /// Runs one step. Marks are held back by one step.
    ///
    /// # Errors
    /// [`GalvoError::InvalidOption`] for settings or a speed out of range,
    /// [`GalvoError::OutsideField`] for a place beyond the field, [`GalvoError::TooManyPulses`] above
    /// [`crate::MAX_PROGRAM_PULSES`], and what else the sink reports.
    pub fn step(&mut self, step: &ProgramStep) -> Result<(), GalvoError> {
        match *step {
            ProgramStep::Settings(settings) => {
                settings.validate()?;
                self.end_stroke()?;
                self.settings = settings;
                self.sink.hold_at_least(hold_us(self.head, &settings));
            }
            ProgramStep::Jump { to_um } => {
                self.check(to_um)?;
                self.end_stroke()?;
                self.jump = Some(to_um);
            }
            ProgramStep::Dwell { duration_us } => {
                let ok = (0.0..=1e9).contains(&duration_us);
                crate::error::check_option("duration_us", duration_us, ok, "in [0, 1e9] µs")?;
                self.end_stroke()?;
                self.arrive(None)?;
                if self.started {
                    self.wait(duration_us)?;
                }
            }
            ProgramStep::Layer { z_um } => {
                self.end_stroke()?;
                self.sink.take(&HeadCommand::Layer { z_um })?;
            }
            ProgramStep::Mark { to_um, speed_m_s, lit } => {
                self.check(to_um)?;
                crate::program::check_speed("speed_m_s", speed_m_s)?;
                self.add(Mark { to_um, speed_m_s, lit })?;
            }
        }
        Ok(())
    }

    /// Ends the program, and hands the sink back.
    ///
    /// # Errors
    /// As [`ProgramRun::step`].
    pub fn end(mut self) -> Result<C, GalvoError> {
        self.end_stroke()?;
        self.arrive(None)?;
        Ok(self.sink)
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

    fn sky(&self) -> Option<&'a SkyWriting> {
        self.head.controller.sky_writing.as_ref()
    }

    fn add(&mut self, mark: Mark) -> Result<(), GalvoError> {
        let from = self.held.map_or(self.jump.unwrap_or(self.drawn_um), |held| held.to_um);
        if from.distance(mark.to_um) <= 0.0 {
            return Ok(());
        }
        if let Some(held) = self.held.take() {
            let direction = (mark.to_um - held.to_um).normalized();
            self.run(held, Some((mark, direction)))?;
        }
        self.held = Some(mark);
        Ok(())
    }

    fn end_stroke(&mut self) -> Result<(), GalvoError> {
        self.held.take().map_or(Ok(()), |held| self.run(held, None))
    }

    fn advance(
        &mut self,
        to_um: Point,
        duration_us: f64,
        purpose: Purpose,
    ) -> Result<(), GalvoError> {
        if duration_us <= 0.0 {
            return Ok(());
        }
        self.at_um = to_um;
        self.sink.take(&HeadCommand::Move { to_um, duration_us, purpose })
    }

    fn wait(&mut self, duration_us: f64) -> Result<(), GalvoError> {
        self.advance(self.at_um, duration_us, Purpose::Delay)
    }

    /// Carries out the jump that is due; with sky writing to the run-in of a mark at this velocity.
    fn arrive(&mut self, velocity: Option<Point>) -> Result<(), GalvoError> {
        let Some(to_um) = self.jump.take() else { return Ok(()) };
        self.drawn_um = to_um;
        let lead = match (self.sky(), velocity) {
            (Some(sky), Some(velocity)) if sky.mode != SkyWritingMode::Retrace => {
                velocity * sky.run_in_us()
            }
            _ => Point::default(),
        };
        self.jump_to(to_um - lead)
    }

    fn jump_to(&mut self, place: Point) -> Result<(), GalvoError> {
        if !self.started {
            self.at_um = place;
            self.started = true;
            return self.sink.take(&HeadCommand::Rest { at_um: place });
        }
        let length_um = self.at_um.distance(place);
        if length_um > 0.0 {
            let speed = self.settings.jump_speed_m_s;
            self.advance(place, length_um / speed, Purpose::Jump)?;
            self.wait(self.settings.delays.after_jump_us(length_um))?;
        }
        Ok(())
    }

    /// Runs a mark; `next` is the mark that continues the stroke, with its direction.
    fn run(&mut self, mark: Mark, next: Option<(Mark, Point)>) -> Result<(), GalvoError> {
        let start = self.jump.unwrap_or(self.drawn_um);
        let direction = (mark.to_um - start).normalized();
        let velocity = direction * mark.speed_m_s;
        let first = !self.in_stroke;
        if first {
            self.arrive(Some(velocity))?;
            self.started = true;
            let begin_um = start + direction * self.settings.run_in_um;
            self.begin_stroke(self.drawn(begin_um, direction), direction, mark)?;
            self.run_in(start, velocity)?;
        }
        self.switch(mark, first)?;
        let before_um = if first { self.settings.run_in_um } else { 0.0 };
        let after_um = if next.is_none() { self.settings.run_out_um } else { 0.0 };
        let Some((next, onward)) = next else {
            self.travel(mark, start, before_um, after_um)?;
            return self.leave(mark, direction);
        };
        let cosine = direction.x * onward.x + direction.y * onward.y;
        self.in_stroke = true;
        if let Some(sky) = self.sky().filter(|sky| sky.breaks_at(cosine)) {
            self.travel(mark, start, before_um, after_um)?;
            return self.break_stroke(sky, mark, direction, next, onward);
        }
        let lag_us = self.head.x.lag_us().max(self.head.y.lag_us());
        let reach_um = mark.speed_m_s * lag_us;
        self.sink.take(&HeadCommand::Corner {
            stroke: self.stroke,
            at_um: mark.to_um,
            reach_um,
        })?;
        self.travel(mark, start, before_um, after_um)?;
        self.wait(self.settings.delays.at_corner_us(cosine))
    }

    fn begin_stroke(
        &mut self,
        at_um: Point,
        direction: Point,
        mark: Mark,
    ) -> Result<(), GalvoError> {
        let begin = self.end_of(at_um, direction, mark.speed_m_s);
        self.sink.take(&HeadCommand::StrokeBegins(begin))
    }

    /// Run-in of sky writing before a mark that starts at `start`.
    fn run_in(&mut self, start: Point, velocity: Point) -> Result<(), GalvoError> {
        let Some(sky) = self.sky() else { return Ok(()) };
        let run_in_us = sky.run_in_us();
        if sky.mode == SkyWritingMode::Retrace {
            self.advance(start - velocity * run_in_us, run_in_us, Purpose::RunIn)?;
        }
        self.advance(start, run_in_us, Purpose::RunIn)
    }

    /// Run-out of sky writing behind a mark that ends at `end`.
    fn run_out(&mut self, end: Point, velocity: Point) -> Result<(), GalvoError> {
        let Some(sky) = self.sky() else { return Ok(()) };
        let run_out_us = sky.run_out_us();
        self.advance(end + velocity * run_out_us, run_out_us, Purpose::RunIn)?;
        if sky.mode == SkyWritingMode::Retrace {
            self.advance(end, run_out_us, Purpose::RunIn)?;
        }
        Ok(())
    }

    /// Switches the laser as the mark that is about to move asks for.
    fn switch(&mut self, mark: Mark, first: bool) -> Result<(), GalvoError> {
        if mark.lit && (first || !self.lit) {
            self.lit = true;
            self.sink.take(&HeadCommand::LaserOn {
                after_us: laser_on_us(self.head, &self.settings),
                pulse_rate_hz: self.settings.pulse_rate_hz,
                stroke: self.stroke,
            })
        } else if mark.lit {
            Ok(())
        } else {
            self.switch_off()
        }
    }

    fn switch_off(&mut self) -> Result<(), GalvoError> {
        if !std::mem::take(&mut self.lit) {
            return Ok(());
        }
        let after_us = laser_off_us(self.head, &self.settings);
        self.sink.take(&HeadCommand::LaserOff { after_us })
    }

    /// Moves along a mark; its first `before_um` and last `after_um` are run-in and run-out.
    fn travel(
        &mut self,
        mark: Mark,
        start: Point,
        before_um: f64,
        after_um: f64,
    ) -> Result<(), GalvoError> {
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
            self.advance(to_um, piece_um / mark.speed_m_s, purpose)?;
        }
        self.drawn_um = mark.to_um;
        Ok(())
    }

    /// Sky writing leaves the stroke at a corner and enters it again.
    fn break_stroke(
        &mut self,
        sky: &SkyWriting,
        mark: Mark,
        direction: Point,
        next: Mark,
        onward: Point,
    ) -> Result<(), GalvoError> {
        self.leave(mark, direction)?;
        let velocity = onward * next.speed_m_s;
        if sky.mode != SkyWritingMode::Retrace {
            self.jump_to(mark.to_um - velocity * sky.run_in_us())?;
        }
        self.begin_stroke(mark.to_um, onward, next)?;
        self.run_in(mark.to_um, velocity)?;
        self.in_stroke = true;
        Ok(())
    }

    /// The stroke ends with the mark that has just moved.
    fn leave(&mut self, mark: Mark, direction: Point) -> Result<(), GalvoError> {
        self.switch_off()?;
        let drawn = self.drawn(mark.to_um - direction * self.settings.run_out_um, direction);
        let end = self.end_of(drawn, direction, mark.speed_m_s);
        self.sink.take(&HeadCommand::StrokeEnds(end))?;
        self.run_out(mark.to_um, direction * mark.speed_m_s)?;
        if self.sky().is_none() {
            self.wait(self.settings.delays.mark_us)?;
        }
        self.in_stroke = false;
        self.stroke += 1;
        Ok(())
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

/// From the start of a stroke's command to laser on, µs.
fn laser_on_us(head: &ScanHead, settings: &ProgramSettings) -> f64 {
    let sky = head.controller.sky_writing.as_ref();
    sky.map_or(settings.delays.laser_on_us, |sky| sky.timelag_us + sky.laser_on_shift_us)
}

/// From the end of a stroke's command to laser off, µs.
fn laser_off_us(head: &ScanHead, settings: &ProgramSettings) -> f64 {
    let sky = head.controller.sky_writing.as_ref();
    sky.map_or(settings.delays.laser_off_us, |sky| sky.timelag_us)
}

/// How long before its time the laser may be switched, µs.
fn hold_us(head: &ScanHead, settings: &ProgramSettings) -> f64 {
    (-laser_on_us(head, settings)).max(-laser_off_us(head, settings)).max(0.0)
}
