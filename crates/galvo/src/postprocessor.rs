//! The adaptive postprocessor: vectors in, extended strokes with their delays out, one at a time.

use lasergym_geom::Point;
use lasergym_toolpath::{VectorStep, arc_chords};

use crate::compensation::{
    Compensation, Compensator, DEFAULT_PITCH_TOLERANCE, HeadKnowledge, Method, StraightStroke,
};
use crate::delays::Delays;
use crate::error::check_option;
use crate::laser::check_pulse_rate;
use crate::program::{ProgramSettings, ProgramStep, check_speed};
use crate::{GalvoError, ScanHead};

/// How the laser is switched.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum LaserControl {
    /// By the delays in the settings: strokes are lit from end to end.
    #[default]
    Delays,
    /// By the program itself, at places on the stroke, for controllers without delays.
    Inline,
}

/// How pulses are set into a stroke of one vector. Strokes of several keep the pitch.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PulseGrid {
    /// The pulse rate is adjusted so that first and last pulse lie where they should.
    #[default]
    Fit,
    /// The pulse rate stays; the end is met within half a pitch.
    Keep,
}

/// How a job becomes a program.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PostOptions {
    /// Which compensation. Default [`Method::Adaptive`].
    pub method: Method,
    /// Speed of all vectors, m/s; none takes those of the job.
    pub speed_m_s: Option<f64>,
    /// Crater diameter by which strokes are shortened, µm, in [0, 1000]. Default 40.
    pub beam_um: f64,
    /// Distance between pulses, µm, in [10⁻³, 10⁴]; none takes the head's pulse rate.
    pub pitch_um: Option<f64>,
    /// Part by which pulses may be nearer or farther apart, in [10⁻⁴, 0.5]. Default 0.02. Less makes
    /// strokes longer.
    pub tolerance: f64,
    /// Vectors that meet at a larger turn are separate strokes, degrees, in [0, 180]. Default 10.
    pub corner_deg: f64,
    /// How the laser is switched.
    pub control: LaserControl,
    /// How pulses are set into a stroke.
    pub grid: PulseGrid,
    /// Delays of the laser are multiples of this, µs, in [0, 100]; 0: exact. Default 0.5, an RTC's.
    pub delay_step_us: f64,
    /// Wait after a jump, µs; none: the time of the run-in and the lag.
    pub jump_delay_us: Option<f64>,
    /// Wait after a stroke, µs; none: the lag.
    pub mark_delay_us: Option<f64>,
    /// Offsets and delays to use instead of those that follow from the head.
    pub fixed: Option<Compensation>,
    /// Where the origin of the job lies in the field, µm, within ±10⁶. Default (0, 0), its middle.
    pub origin_um: Point,
}

impl Default for PostOptions {
    fn default() -> Self {
        Self {
            method: Method::Adaptive,
            speed_m_s: None,
            beam_um: 40.0,
            pitch_um: None,
            tolerance: DEFAULT_PITCH_TOLERANCE,
            corner_deg: 10.0,
            control: LaserControl::Delays,
            grid: PulseGrid::Fit,
            delay_step_us: 0.5,
            jump_delay_us: None,
            mark_delay_us: None,
            fixed: None,
            origin_um: Point::default(),
        }
    }
}

impl PostOptions {
    /// Accepts finite values within the ranges of their fields.
    ///
    /// # Errors
    /// [`GalvoError::InvalidOption`] names the first value outside its range.
    pub fn validate(&self) -> Result<(), GalvoError> {
        if let Some(speed) = self.speed_m_s {
            check_speed("speed_m_s", speed)?;
        }
        let beam = self.beam_um;
        check_option("beam_um", beam, (0.0..=1e3).contains(&beam), "in [0, 1000] µm")?;
        if let Some(pitch) = self.pitch_um {
            check_option("pitch_um", pitch, (1e-3..=1e4).contains(&pitch), "in [1e-3, 1e4] µm")?;
        }
        let tolerance = self.tolerance;
        let ok = (1e-4..=0.5).contains(&tolerance);
        check_option("tolerance", tolerance, ok, "in [1e-4, 0.5]")?;
        let corner = self.corner_deg;
        check_option("corner_deg", corner, (0.0..=180.0).contains(&corner), "in [0, 180]°")?;
        let step = self.delay_step_us;
        check_option("delay_step_us", step, (0.0..=100.0).contains(&step), "in [0, 100] µs")?;
        for (name, delay) in
            [("jump_delay_us", self.jump_delay_us), ("mark_delay_us", self.mark_delay_us)]
        {
            let delay = delay.unwrap_or(0.0);
            check_option(name, delay, (0.0..=1e6).contains(&delay), "in [0, 1e6] µs")?;
        }
        for (name, at) in [("origin_x_um", self.origin_um.x), ("origin_y_um", self.origin_um.y)] {
            check_option(name, at, at.abs() <= 1e6, "within ±1e6 µm")?;
        }
        Ok(())
    }
}

/// Chords stay within this of their arcs, µm.
const ARC_TOLERANCE_UM: f64 = 0.05;

/// Length of the vector in whose middle a single pulse fires, µm.
const PULSE_VECTOR_UM: f64 = 0.1;

/// Stretches below this are rounding, µm: the laser is not switched for them.
const ROUNDING_UM: f64 = 1e-6;

/// A vector of the stroke under way.
#[derive(Debug, Clone, Copy)]
struct Vector {
    from: Point,
    to: Point,
    direction: Point,
    speed_m_s: f64,
    /// Whether it gets one pulse in its middle, whatever its length.
    single: bool,
}

impl Vector {
    /// To the left of its direction, of length 1.
    fn normal(&self) -> Point {
        Point::new(-self.direction.y, self.direction.x)
    }

    /// With its ends moved by `start` and `end`, in the same time.
    fn moved(self, start: Point, end: Point) -> Self {
        if start == Point::default() && end == Point::default() {
            return self;
        }
        let (from, to) = (self.from + start, self.to + end);
        let stretched = from.distance(to) / self.from.distance(self.to);
        Self {
            from,
            to,
            direction: (to - from).normalized(),
            speed_m_s: self.speed_m_s * stretched,
            single: self.single,
        }
    }
}

/// Turns a job into a program, vector by vector, in constant memory.
#[derive(Debug)]
pub struct Postprocessor<'a, S> {
    head: &'a ScanHead,
    compensator: Compensator<'a>,
    options: PostOptions,
    sink: S,
    at_um: Option<Point>,
    held: Option<Vector>,
    /// Whether the held vector begins its stroke.
    first: bool,
    /// Way until the laser goes on, with [`LaserControl::Inline`], µm.
    dark_um: f64,
    jump_speed_m_s: f64,
    /// Time in which the head settles after a jump, µs.
    after_jump_us: f64,
    /// How far the command is beside the drawn path at the start of the held vector, µm.
    shift: Point,
    settings: Option<ProgramSettings>,
    vectors: u64,
    least_cosine: f64,
}

impl<'a, S: FnMut(&ProgramStep) -> Result<(), GalvoError>> Postprocessor<'a, S> {
    /// A postprocessor for a head of which `knowledge` is known; steps go to `sink`.
    ///
    /// # Errors
    /// [`GalvoError::InvalidOption`] when [`PostOptions::validate`] refuses the options.
    pub fn new(
        head: &'a ScanHead,
        knowledge: &'a HeadKnowledge,
        options: PostOptions,
        sink: S,
    ) -> Result<Self, GalvoError> {
        options.validate()?;
        let PostOptions { method, beam_um, tolerance, .. } = options;
        let compensator = Compensator::new(knowledge, method, beam_um, tolerance)?;
        let jump_speed_m_s = compensator.jump_speed_m_s(head.controller.jump_speed_m_s);
        Ok(Self {
            head,
            jump_speed_m_s,
            after_jump_us: compensator.settled_us(jump_speed_m_s),
            compensator,
            options,
            sink,
            at_um: None,
            held: None,
            first: true,
            dark_um: 0.0,
            shift: Point::default(),
            settings: None,
            vectors: 0,
            least_cosine: options.corner_deg.to_radians().cos(),
        })
    }

    /// Vectors so far.
    #[must_use]
    pub fn vectors(&self) -> u64 {
        self.vectors
    }

    /// Takes the next step of the job.
    ///
    /// # Errors
    /// [`GalvoError::SpeedUnknown`] for a vector without speed, [`GalvoError::OutsideField`] for one
    /// that leaves the field with its run-in, what the sink reports, and
    /// [`GalvoError::InvalidOption`], also for a vector so slow that its delays are out of range.
    pub fn step(&mut self, step: &VectorStep) -> Result<(), GalvoError> {
        let origin = self.options.origin_um;
        match *step {
            VectorStep::Jump { to_um } => {
                self.end_stroke()?;
                self.at_um = Some(to_um + origin);
            }
            VectorStep::Layer { z_um } => {
                self.end_stroke()?;
                (self.sink)(&ProgramStep::Layer { z_um })?;
            }
            VectorStep::Mark { to_um, speed_m_s } => self.mark(to_um + origin, speed_m_s)?,
            VectorStep::Pulse { at_um } => self.pulse(at_um + origin)?,
            VectorStep::Arc { to_um, center_um, counterclockwise, speed_m_s } => {
                let from = self.at_um.unwrap_or(self.options.origin_um);
                let (to, center) = (to_um + origin, center_um + origin);
                for chord in arc_chords(from, to, center, counterclockwise, ARC_TOLERANCE_UM) {
                    self.mark(chord, speed_m_s)?;
                }
            }
        }
        Ok(())
    }

    /// A stroke through `at`, in the direction in which the beam comes, with one pulse there.
    fn pulse(&mut self, at: Point) -> Result<(), GalvoError> {
        self.end_stroke()?;
        self.vectors += 1;
        let way = at - self.at_um.unwrap_or(self.options.origin_um);
        let direction = if way.length() > 0.0 { way.normalized() } else { Point::new(1.0, 0.0) };
        self.at_um = Some(at);
        let Some(speed_m_s) = self.options.speed_m_s else {
            return Err(GalvoError::SpeedUnknown { vector: self.vectors });
        };
        let half = direction * (0.5 * PULSE_VECTOR_UM);
        self.first = true;
        self.held =
            Some(Vector { from: at - half, to: at + half, direction, speed_m_s, single: true });
        self.end_stroke()
    }

    /// Ends the job.
    ///
    /// # Errors
    /// As [`Postprocessor::step`].
    pub fn finish(&mut self) -> Result<(), GalvoError> {
        self.end_stroke()
    }

    fn mark(&mut self, to: Point, speed_m_s: Option<f64>) -> Result<(), GalvoError> {
        self.vectors += 1;
        let from = self.at_um.unwrap_or(self.options.origin_um);
        self.at_um = Some(to);
        let direction = (to - from).normalized();
        let Some(speed_m_s) = self.options.speed_m_s.or(speed_m_s) else {
            return Err(GalvoError::SpeedUnknown { vector: self.vectors });
        };
        check_speed("speed_m_s", speed_m_s)?;
        if from.distance(to) <= 0.0 {
            return Ok(());
        }
        let vector = Vector { from, to, direction, speed_m_s, single: false };
        if let Some(held) = self.held {
            let cosine = held.direction.x * direction.x + held.direction.y * direction.y;
            let same_speed = (held.speed_m_s - speed_m_s).abs() <= 1e-9 * speed_m_s;
            if same_speed && cosine >= self.least_cosine {
                self.emit(held, Some(vector))?;
                self.first = false;
                self.held = Some(vector);
                return Ok(());
            }
            self.end_stroke()?;
        }
        self.first = true;
        self.held = Some(vector);
        Ok(())
    }

    fn end_stroke(&mut self) -> Result<(), GalvoError> {
        let Some(held) = self.held.take() else { return Ok(()) };
        self.emit(held, None)?;
        self.first = true;
        Ok(())
    }

    /// Offsets and delays of a vector; of one that is a stroke by itself with its length.
    fn compensation(&mut self, vector: &Vector, alone: bool) -> Result<Compensation, GalvoError> {
        if let Some(fixed) = self.options.fixed {
            return Ok(fixed);
        }
        self.compensator.compensation(&StraightStroke {
            speed_m_s: vector.speed_m_s,
            direction: vector.direction,
            length_um: alone.then(|| vector.from.distance(vector.to)),
        })
    }

    /// Hands out a vector, moved beside where it is drawn when the axes have different lags; `next`
    /// continues the stroke.
    fn emit(&mut self, drawn: Vector, next: Option<Vector>) -> Result<(), GalvoError> {
        let last = next.is_none();
        let alone = self.first && last;
        let found = self.compensation(&drawn, alone)?;
        let own = drawn.normal() * found.lateral_um;
        let start = if self.first { own } else { self.shift };
        self.shift = match next {
            // Where vectors meet the command takes the mean of what they need.
            Some(next) => {
                let onward = self.compensation(&next, false)?;
                (own + next.normal() * onward.lateral_um) * 0.5
            }
            None => own,
        };
        let vector = drawn.moved(start, self.shift);
        let plan = self.plan(&found, &drawn, alone)?;
        let inline = self.options.control == LaserControl::Inline;
        let Vector { from, to, direction, speed_m_s, .. } = vector;
        if self.first {
            self.settle_settings(plan.settings)?;
            self.jump(from - direction * found.run_in_um)?;
            self.dark_um = if inline { plan.on_us * speed_m_s } else { 0.0 };
        }
        let mut at = if self.first { from - direction * found.run_in_um } else { from };
        let end = if last { to + direction * plan.settings.run_out_um } else { to };
        if !inline {
            return self.go(end, speed_m_s, true);
        }
        // The laser goes on where the command is when the beam reaches the first pulse.
        let length_um = at.distance(end);
        let dark_um = self.dark_um.min(length_um);
        if dark_um > ROUNDING_UM {
            at = at + direction * dark_um;
            self.dark_um -= dark_um;
            self.go(at, speed_m_s, false)?;
        }
        let lit_end = if last { end + direction * (plan.off_us.min(0.0) * speed_m_s) } else { end };
        if (lit_end - at).x * direction.x + (lit_end - at).y * direction.y > ROUNDING_UM {
            self.go(lit_end, speed_m_s, true)?;
        }
        if last && lit_end.distance(end) > 0.0 {
            self.go(end, speed_m_s, false)?;
        }
        Ok(())
    }

    /// Settings of the stroke that begins with `vector`, or is nothing else when `alone`.
    fn plan(
        &self,
        found: &Compensation,
        vector: &Vector,
        alone: bool,
    ) -> Result<StrokePlan, GalvoError> {
        let (head, options) = (self.head, &self.options);
        let speed = vector.speed_m_s;
        let rate_hz =
            options.pitch_um.map_or(head.laser.pulse_rate_hz, |pitch_um| speed / pitch_um * 1e6);
        check_pulse_rate(rate_hz)?;
        let mut period_us = 1e6 / rate_hz;
        let (mut on_us, mut off_us) = (found.on_us, found.off_us);
        let length_um = vector.from.distance(vector.to);
        let compensated = options.method != Method::None;
        let beam_um = if compensated { options.beam_um } else { 0.0 };
        // From the first pulse to the last.
        let way_um = found.run_in_um + length_um + found.run_out_um;
        let lit_us = way_um / speed + off_us - on_us;
        if alone && compensated {
            if vector.single || lit_us < 0.5 * period_us {
                // Too short for two craters, or meant for one: it is in the middle.
                on_us += 0.5 * lit_us;
                off_us -= 0.5 * lit_us;
            } else if options.grid == PulseGrid::Fit {
                period_us = lit_us / (lit_us / period_us).round().max(1.0);
            }
        }
        if vector.single {
            // The last pulse is the first.
            off_us = on_us - way_um / speed;
        }
        // The gate closes half a period behind the last pulse, so that rounding loses none.
        let margin_us = if compensated { 0.5 * period_us } else { 1e-3 };
        on_us -= head.laser.response_us;
        off_us += margin_us - head.laser.response_us;
        let mut run_out_um = found.run_out_um;
        if options.control == LaserControl::Inline && off_us > 0.0 {
            run_out_um += off_us * speed;
            off_us = 0.0;
        }
        let inline = options.control == LaserControl::Inline;
        let (on_step, off_step) = if inline {
            (0.0, 0.0)
        } else {
            (stepped(on_us, options.delay_step_us), stepped(off_us, options.delay_step_us))
        };
        let settle = |default_us: f64| {
            if options.delay_step_us > 0.0 { (0.1 * default_us).ceil() * 10.0 } else { default_us }
        };
        // The beam must have forgotten a jump at the first pulse.
        let jump_us = self.after_jump_us;
        let mark_us = found.lag_us + off_step.max(0.0);
        let delays = Delays {
            jump_us: options.jump_delay_us.unwrap_or_else(|| settle(jump_us)),
            mark_us: options.mark_delay_us.unwrap_or_else(|| settle(mark_us)),
            laser_on_us: on_step,
            laser_off_us: off_step,
            ..Delays::default()
        };
        let settings = ProgramSettings {
            pulse_rate_hz: 1e6 / period_us,
            delays,
            jump_speed_m_s: self.jump_speed_m_s,
            run_in_um: found.run_in_um,
            run_out_um,
            lateral_um: found.lateral_um,
            beam_um: if compensated { beam_um.min(length_um.max(0.0)) } else { 0.0 },
        };
        Ok(StrokePlan { settings, on_us, off_us })
    }

    fn settle_settings(&mut self, settings: ProgramSettings) -> Result<(), GalvoError> {
        if self.settings != Some(settings) {
            // Very slow vectors have longer delays than a controller knows.
            settings.validate()?;
            self.settings = Some(settings);
            (self.sink)(&ProgramStep::Settings(settings))?;
        }
        Ok(())
    }

    fn jump(&mut self, to: Point) -> Result<(), GalvoError> {
        let to_um = self.told(to)?;
        (self.sink)(&ProgramStep::Jump { to_um })
    }

    fn go(&mut self, to: Point, speed_m_s: f64, lit: bool) -> Result<(), GalvoError> {
        let to_um = self.told(to)?;
        (self.sink)(&ProgramStep::Mark { to_um, speed_m_s, lit })
    }

    fn told(&self, place: Point) -> Result<Point, GalvoError> {
        let told = self.head.field.telling(place);
        if self.head.field.contains(told) {
            return Ok(told);
        }
        Err(GalvoError::OutsideField {
            vector: self.vectors,
            x_um: told.x,
            y_um: told.y,
            half_um: self.head.field.half_um(),
        })
    }
}

/// Settings of a stroke.
struct StrokePlan {
    settings: ProgramSettings,
    /// Laser on after the start of the command, µs.
    on_us: f64,
    /// Laser off after the end of the command, µs.
    off_us: f64,
}

/// `value_us` as a multiple of `step_us`.
fn stepped(value_us: f64, step_us: f64) -> f64 {
    if step_us > 0.0 { (value_us / step_us).round() * step_us } else { value_us }
}
