//! A rig: the world that stage, laser and camera share.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use lasergym_ablation::Stream;
use lasergym_geom::Point;

use super::state::{Event, direction, exponential, poisson, stream_of};
use super::surface::Surface;
use super::view::{Exposure, Sensor};
use super::{
    IMAGING_POSITION_UM, PhaseTimes, RigState, SimulatedCamera, SimulatedError, SimulatedLaser,
    SimulatedStage, SimulatorOptions, Speck, TrueMark,
};
use crate::CameraCalibration;

/// Largest radius of a speck, px of the pattern.
const MAX_SPECK_RADIUS_PX: f64 = 3.0;

/// A simulated machine. Its devices are handles: they share one workpiece, and so do clones.
#[derive(Debug, Clone)]
pub struct Rig {
    world: Arc<Mutex<World>>,
}

impl Rig {
    /// A fresh workpiece in a rig with the errors `options`; the stage stands at the imaging
    /// position. The same seed gives the same rig.
    ///
    /// # Errors
    /// [`SimulatedError::InvalidOption`].
    pub fn new(options: SimulatorOptions, seed: u64) -> Result<Self, SimulatedError> {
        options.validate()?;
        let imaging = [IMAGING_POSITION_UM.x, IMAGING_POSITION_UM.y];
        let mut world = World::show(RigState {
            exposure_s: options.exposure_s,
            options,
            seed,
            marks: Vec::new(),
            specks: Vec::new(),
            commanded_um: imaging,
            screw_um: imaging,
            carriage_um: imaging,
            frame_taken_at_um: imaging,
            moves: 0,
            pulses: 0,
            frames: 0,
            armed: false,
            elapsed: PhaseTimes::default(),
        });
        let mut stream = stream_of(seed, Event::Dust, u64::MAX);
        let count = poisson(&mut stream, world.state.options.dust_specks);
        world.settle_dust(count, &mut stream);
        Ok(Self { world: Arc::new(Mutex::new(world)) })
    }

    /// The rig that was in `state`: it goes on exactly as the first would have.
    ///
    /// # Errors
    /// [`SimulatedError::InvalidOption`], or [`SimulatedError::State`] for numbers that are not
    /// finite and marks or specks that are too large.
    pub fn from_state(state: RigState) -> Result<Self, SimulatedError> {
        state.options.validate()?;
        let refuse = |reason: &str| Err(SimulatedError::State { reason: reason.to_owned() });
        let finite = |values: &[f64]| values.iter().all(|value| value.is_finite());
        let positions = [
            state.commanded_um,
            state.screw_um,
            state.carriage_um,
            state.frame_taken_at_um,
            [state.exposure_s, state.elapsed.total_s()],
        ];
        if !positions.iter().all(|position| finite(position)) {
            return refuse("a position or time is not finite");
        }
        if !state
            .marks
            .iter()
            .all(|mark| finite(&[mark.x_px, mark.y_px]) && (0.0..=100.0).contains(&mark.radius_px))
        {
            return refuse("a mark is not finite or larger than the workpiece");
        }
        if !state.specks.iter().all(|speck| {
            finite(&[speck.x_px, speck.y_px])
                && (0.0..=MAX_SPECK_RADIUS_PX).contains(&speck.radius_px)
                && (0.0..=1.0).contains(&speck.opacity)
        }) {
            return refuse("a speck is not finite or too large");
        }
        Ok(Self { world: Arc::new(Mutex::new(World::show(state))) })
    }

    /// All that the rig is made of now.
    #[must_use]
    pub fn state(&self) -> RigState {
        self.lock().state.clone()
    }

    /// Its stage.
    #[must_use]
    pub fn stage(&self) -> SimulatedStage {
        SimulatedStage::new(self.clone())
    }

    /// Its laser.
    #[must_use]
    pub fn laser(&self) -> SimulatedLaser {
        SimulatedLaser::new(self.clone())
    }

    /// Its camera.
    #[must_use]
    pub fn camera(&self) -> SimulatedCamera {
        SimulatedCamera::new(self.clone())
    }

    /// What has really been machined, in order.
    #[must_use]
    pub fn true_marks(&self) -> Vec<TrueMark> {
        self.lock().state.marks.clone()
    }

    /// How far the stage was from the imaging position when the last frame was exposed, µm. What
    /// the camera sees is shifted by the opposite.
    #[must_use]
    pub fn frame_displacement_um(&self) -> Point {
        let [x, y] = self.lock().state.frame_taken_at_um;
        Point::new(x, y) - IMAGING_POSITION_UM
    }

    /// How the camera sees a stage that stands exactly at the imaging position.
    #[must_use]
    pub fn true_calibration(&self) -> CameraCalibration {
        let world = self.lock();
        let options = &world.state.options;
        let origin = world.frame_px(Point::default());
        let across = world.frame_px(Point::new(1.0, 0.0)) - origin;
        let down = world.frame_px(Point::new(0.0, 1.0)) - origin;
        CameraCalibration::exact(
            options.frame_width_px,
            options.frame_height_px,
            [[across.x, down.x, origin.x], [across.y, down.y, origin.y]],
        )
    }

    /// Virtual time so far, phase by phase.
    #[must_use]
    pub fn elapsed_s(&self) -> PhaseTimes {
        self.lock().state.elapsed
    }

    /// Lets `count` specks of dust settle anywhere in view.
    pub fn settle_dust(&self, count: usize) {
        let mut world = self.lock();
        let mut stream = stream_of(world.state.seed, Event::Dust, world.state.specks.len() as u64);
        world.settle_dust(count, &mut stream);
    }

    /// The world; a thread that panicked while it held the world has left it whole, since nothing
    /// in it can panic half way.
    pub(super) fn lock(&self) -> MutexGuard<'_, World> {
        self.world.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// State and picture of a rig.
#[derive(Debug)]
pub(super) struct World {
    pub(super) state: RigState,
    surface: Surface,
    sensor: Sensor,
}

impl World {
    /// The world in `state`.
    fn show(state: RigState) -> Self {
        let surface = Surface::new(&state.options, state.seed);
        let sensor = Sensor::new(&state.options, state.seed);
        let mut world = Self { state, surface, sensor };
        for (index, mark) in world.state.marks.clone().iter().enumerate() {
            world.draw_mark(mark, index);
        }
        let specks = world.state.specks.clone();
        world.draw_specks(&specks);
        world
    }

    /// Where the frame shows `position_px` of the pattern from the imaging position, frame px.
    fn frame_px(&self, position_px: Point) -> Point {
        let options = &self.state.options;
        let axis = Point::new(
            0.5 * options.frame_width_px as f64 + options.offset_x_frame_px,
            0.5 * options.frame_height_px as f64 + options.offset_y_frame_px,
        );
        axis + self.frame_vector(position_px - IMAGING_POSITION_UM)
    }

    /// A displacement on the workpiece in the frame, frame px.
    fn frame_vector(&self, displacement_um: Point) -> Point {
        let options = &self.state.options;
        (displacement_um * options.scale_frame_px_per_um)
            .rotated_about(Point::default(), options.rotation_deg.to_radians())
    }

    fn draw_mark(&mut self, mark: &TrueMark, index: usize) {
        let center = self.frame_px(mark.center_px());
        let radius = mark.radius_px * self.state.options.scale_frame_px_per_um;
        let mut stream = stream_of(self.state.seed, Event::Ground, 1 + index as u64);
        self.surface.machine(center, radius, stream.integer_pair_below(1 << 16));
    }

    /// Shows the specks where `changed` were or are.
    fn draw_specks(&mut self, changed: &[Speck]) {
        let place = |speck: &Speck| {
            let center = self.frame_px(Point::new(speck.x_px, speck.y_px));
            Speck {
                x_px: center.x,
                y_px: center.y,
                radius_px: speck.radius_px * self.state.options.scale_frame_px_per_um,
                ..*speck
            }
        };
        let specks: Vec<Speck> = self.state.specks.iter().map(place).collect();
        let changed: Vec<Speck> = changed.iter().map(place).collect();
        self.surface.strew(&specks, &changed);
    }

    /// A speck at `position_px` of random size.
    fn speck(&self, position_px: Point, stream: &mut Stream) -> Speck {
        let radius = self.state.options.fragment_radius_um * (0.4 * stream.normal()).exp();
        Speck {
            x_px: position_px.x,
            y_px: position_px.y,
            radius_px: radius.min(MAX_SPECK_RADIUS_PX),
            opacity: 0.15 + 0.45 * stream.uniform(),
        }
    }

    fn settle_dust(&mut self, count: usize, stream: &mut Stream) {
        let options = &self.state.options;
        let side = options.frame_width_px.max(options.frame_height_px) as f64;
        let side_um = side / options.scale_frame_px_per_um;
        let specks: Vec<Speck> = (0..count)
            .map(|_| {
                let offset = Point::new(stream.uniform() - 0.5, stream.uniform() - 0.5);
                self.speck(IMAGING_POSITION_UM + offset * side_um, stream)
            })
            .collect();
        self.state.specks.extend_from_slice(&specks);
        self.draw_specks(&specks);
    }

    /// Where the carriage really is, without vibration, µm.
    fn carriage_um(&self) -> Point {
        let [x, y] = self.state.carriage_um;
        let drift_um = self.state.options.drift_um_per_move * self.state.moves as f64;
        Point::new(x, y) + direction(&mut stream_of(self.state.seed, Event::Drift, 0)) * drift_um
    }

    /// Sends the screw to `position_um`; the carriage follows with its play.
    pub(super) fn travel(&mut self, position_um: Point) {
        let state = &mut self.state;
        let options = &state.options;
        let mut stream = stream_of(state.seed, Event::Move, state.moves);
        let error = stream.displacement(options.settling_error_um);
        let [x, y] = state.commanded_um;
        let distance_um = position_um.distance(Point::new(x, y));
        let (speed, acceleration) = (options.stage_speed_um_s, options.stage_acceleration_um_s2);
        state.elapsed.move_s += if distance_um * acceleration < speed * speed {
            2.0 * (distance_um / acceleration).sqrt()
        } else {
            distance_um / speed + speed / acceleration
        };
        state.elapsed.settle_s += options.settle_s;
        state.moves += 1;
        let half_play = 0.5 * options.backlash_um;
        let screw = position_um + error;
        state.commanded_um = [position_um.x, position_um.y];
        state.screw_um = [screw.x, screw.y];
        for (carriage, screw) in state.carriage_um.iter_mut().zip(state.screw_um) {
            *carriage = carriage.clamp(screw - half_play, screw + half_play);
        }
    }

    /// What the laser does when it is told to fire.
    pub(super) fn fire(&mut self) {
        let mut stream = stream_of(self.state.seed, Event::Pulse, self.state.pulses);
        let pulse = self.state.pulses;
        self.state.pulses += 1;
        self.state.elapsed.pulse_s += self.state.options.pulse_s;
        let chance = stream.uniform();
        let options = self.state.options.clone();
        let shots = if chance < options.misfire_probability {
            0
        } else if chance > 1.0 - options.double_fire_probability {
            2
        } else {
            1
        };
        let knock = if stream.uniform() < options.impulse_probability {
            direction(&mut stream) * options.impulse_um
        } else {
            Point::default()
        };
        for _ in 0..shots {
            let center = self.carriage_um() + knock + stream.displacement(options.vibration_um);
            let radius = options.pulse_radius_px + options.radius_noise_px * stream.normal();
            let mark =
                TrueMark { x_px: center.x, y_px: center.y, radius_px: radius.max(1.0), pulse };
            self.state.marks.push(mark);
            self.draw_mark(&mark, self.state.marks.len() - 1);
            self.blow(&mark, &mut stream);
        }
    }

    /// The shock wave of a pulse: what lay on the mark is gone, specks near it move, and new
    /// fragments land about it.
    fn blow(&mut self, mark: &TrueMark, stream: &mut Stream) {
        let options = self.state.options.clone();
        let reach = options.fragment_distance_um;
        let mut changed = Vec::new();
        let mut specks = Vec::with_capacity(self.state.specks.len());
        for speck in std::mem::take(&mut self.state.specks) {
            let position = Point::new(speck.x_px, speck.y_px);
            let distance = position.distance(mark.center_px());
            if distance < mark.radius_px {
                changed.push(speck);
            } else if distance < mark.radius_px + reach
                && stream.uniform() < options.blown_probability
            {
                changed.push(speck);
                let away = (position - mark.center_px()).normalized();
                let landed = position + away * exponential(stream, reach);
                let moved = Speck { x_px: landed.x, y_px: landed.y, ..speck };
                changed.push(moved);
                specks.push(moved);
            } else {
                specks.push(speck);
            }
        }
        for _ in 0..poisson(stream, options.fragments_per_pulse) {
            let distance = mark.radius_px + exponential(stream, reach);
            let landed = mark.center_px() + direction(stream) * distance;
            let fragment = self.speck(landed, stream);
            changed.push(fragment);
            specks.push(fragment);
        }
        self.state.specks = specks;
        self.draw_specks(&changed);
    }

    /// Exposes a frame: its grey levels, row by row.
    pub(super) fn expose(&mut self) -> Vec<u8> {
        let mut stream = stream_of(self.state.seed, Event::Frame, self.state.frames);
        self.state.frames += 1;
        self.state.elapsed.expose_s += self.state.exposure_s + self.state.options.readout_s;
        let dust = poisson(&mut stream, self.state.options.dust_per_frame);
        if dust > 0 {
            self.settle_dust(dust, &mut stream);
        }
        let options = &self.state.options;
        let position = self.carriage_um() + stream.displacement(options.vibration_um);
        self.state.frame_taken_at_um = [position.x, position.y];
        let lamp = 1.0 + options.flicker_fraction * stream.normal();
        let exposure = Exposure {
            shift: self.frame_vector(position - IMAGING_POSITION_UM),
            gain: lamp.max(0.0) * self.state.exposure_s / options.exposure_s,
            tilt: stream.displacement(options.flicker_tilt_fraction),
            defocus: (options.focus_jitter_frame_px * stream.normal()).abs(),
        };
        self.sensor.expose(&self.surface, exposure, options, &mut stream)
    }
}
