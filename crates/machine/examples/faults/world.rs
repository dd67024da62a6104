//! A machine of which everything can fail, hang, lie or die: one shared world behind its drivers.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use lasergym_ablation::{Pulse, Stream};
use lasergym_geom::Point;
use lasergym_machine::{
    Camera, Device, Drivers, Fault, FaultKind, Frame, Laser, Mark, Observation, Observer,
    ObserverError, Stage, StageLimits, Verdict,
};

/// Where frames are taken, µm.
pub(crate) const IMAGING_UM: Point = Point::new(50.0, 50.0);

/// Tolerance of the stage, µm.
pub(crate) const TOLERANCE_UM: f64 = 0.5;

/// Deadline of every call.
pub(crate) const DEADLINE: Duration = Duration::from_millis(10);

/// How long a call hangs.
const HANG: Duration = Duration::from_millis(25);

/// Radius of a mark, px.
pub(crate) const RADIUS_PX: f64 = 9.0;

/// What may go wrong with a call.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Injection {
    /// It does nothing and says so.
    Fails,
    /// It does what it should and says that it did not.
    FailsAfterwards,
    /// It does nothing for too long.
    Hangs,
    /// It does what it should, too late.
    HangsFirst,
    /// Its driver panics.
    Panics,
    /// It says that it has done what it has not, or what cannot be.
    Lies,
    /// A second kind of lie.
    LiesOtherwise,
    /// A third kind of lie.
    LiesDifferently,
    /// The process dies before it does anything.
    Dies,
    /// The process dies when it has done it.
    DiesAfterwards,
    /// The user wants to stop.
    Interrupts,
}

use Injection::{
    Dies, DiesAfterwards, Fails, FailsAfterwards, Hangs, HangsFirst, Interrupts, Lies,
    LiesDifferently, LiesOtherwise, Panics,
};

/// Every way in which calls fail that tell no lies.
const HONEST: [Injection; 8] =
    [Fails, FailsAfterwards, Hangs, HangsFirst, Panics, Dies, DiesAfterwards, Interrupts];

/// Which call goes wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Planned {
    /// The call of this number, from 1, whatever it is.
    Number(u64),
    /// The next call of this name.
    Name(&'static str),
}

/// The truth about a workpiece and the machine about it.
#[derive(Debug)]
pub(crate) struct World {
    position_um: Point,
    heading_um: Point,
    commanded_um: Point,
    armed: bool,
    marks: Vec<Pulse>,
    /// How far beside the stage's position marks come to lie.
    landing_error_px: Point,
    violations: Vec<String>,
    stream: Stream,
    /// Chance of an injection in a call.
    chance: f64,
    injected: BTreeMap<(&'static str, Injection), u64>,
    /// Calls so far.
    calls: u64,
    /// What is to go wrong, once.
    planned: Option<(Planned, Injection)>,
    process: u64,
    dead: bool,
    disarm_failed: bool,
    drivers_alive: usize,
    stop: Arc<AtomicBool>,
}

/// How much more often than others a call goes wrong: those that come first in every process, and
/// those that come often, would have most of the faults otherwise.
fn weight(call: &str) -> f64 {
    match call {
        "arm" | "fire" | "frame" | "observe" | "save_frame" => 4.0,
        "position_um" => 0.5,
        _ => 1.0,
    }
}

/// The world, shared by all that touch it.
#[derive(Debug, Clone)]
pub(crate) struct SharedWorld(Arc<Mutex<World>>);

impl SharedWorld {
    pub(crate) fn new(seed: u64, chance: f64) -> Self {
        Self(Arc::new(Mutex::new(World {
            position_um: Point::default(),
            heading_um: Point::default(),
            commanded_um: Point::default(),
            armed: false,
            marks: Vec::new(),
            landing_error_px: Point::default(),
            violations: Vec::new(),
            stream: Stream::from_seed(seed),
            chance,
            injected: BTreeMap::new(),
            calls: 0,
            planned: None,
            process: 0,
            dead: false,
            disarm_failed: false,
            drivers_alive: 0,
            stop: Arc::default(),
        })))
    }

    pub(crate) fn lock(&self) -> MutexGuard<'_, World> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A fresh process with its drivers.
    pub(crate) fn start_process(&self) -> Process {
        let mut world = self.lock();
        world.process += 1;
        world.dead = false;
        world.disarm_failed = false;
        world.stop = Arc::default();
        world.drivers_alive = 3;
        Process { world: self.clone(), id: world.process, stop: Arc::clone(&world.stop) }
    }

    /// Waits until nothing of the last process is left: also calls that hang come back, and its
    /// laser is disarmed as the last thing, unless the process has died.
    pub(crate) fn end_process(&self) {
        for _ in 0..100_000 {
            if self.lock().drivers_alive == 0 {
                break;
            }
            thread::sleep(Duration::from_micros(50));
        }
        let mut world = self.lock();
        if world.drivers_alive > 0 {
            world.violations.push("a driver was never let go".to_owned());
        }
        if world.armed && !world.dead {
            world.violations.push("the laser was left armed".to_owned());
        }
    }
}

impl World {
    pub(crate) fn marks(&self) -> &[Pulse] {
        &self.marks
    }

    pub(crate) fn violations(&self) -> &[String] {
        &self.violations
    }

    pub(crate) fn injected(&self) -> &BTreeMap<(&'static str, Injection), u64> {
        &self.injected
    }

    pub(crate) fn is_dead(&self) -> bool {
        self.dead
    }

    pub(crate) fn die(&mut self) {
        self.dead = true;
    }

    pub(crate) fn calls(&self) -> u64 {
        self.calls
    }

    /// Lets `injection` happen to a call, once.
    pub(crate) fn plan(&mut self, planned: Planned, injection: Injection) {
        self.planned = Some((planned, injection));
    }

    pub(crate) fn set_chance(&mut self, chance: f64) {
        self.chance = chance;
    }

    pub(crate) fn uniform(&mut self) -> f64 {
        self.stream.uniform()
    }

    /// An integer in 0..=`most`.
    pub(crate) fn at_most(&mut self, most: usize) -> usize {
        (self.uniform() * (most + 1) as f64) as usize
    }

    /// Lets marks lie beside the stage's position from now on.
    #[allow(dead_code, reason = "only tests bend the machine")]
    pub(crate) fn bend(&mut self, landing_error_px: Point) {
        self.landing_error_px = landing_error_px;
    }

    /// What goes wrong with this call, if anything.
    pub(crate) fn draw(&mut self, call: &'static str, lies: &[Injection]) -> Option<Injection> {
        self.draw_from(call, &HONEST, lies)
    }

    pub(crate) fn draw_from(
        &mut self,
        call: &'static str,
        honest: &[Injection],
        lies: &[Injection],
    ) -> Option<Injection> {
        if self.dead {
            return None;
        }
        self.calls += 1;
        let is_next = |planned| match planned {
            Planned::Number(number) => number == self.calls,
            Planned::Name(name) => name == call,
        };
        if let Some((planned, injection)) = self.planned
            && is_next(planned)
        {
            self.planned = None;
            return Some(injection);
        }
        if self.uniform() >= self.chance * weight(call) {
            return None;
        }
        let k = self.at_most(honest.len() + lies.len() - 1);
        let injection = *honest.iter().chain(lies).nth(k)?;
        *self.injected.entry((call, injection)).or_default() += 1;
        Some(injection)
    }

    fn violate(&mut self, what: &str) {
        let at = self.position_um;
        self.violations.push(format!("{what} at ({}, {}) µm", at.x, at.y));
    }

    fn pulse(&mut self, displacement_px: Point) {
        let side = 0.0..=100.0;
        if !(side.contains(&self.position_um.x) && side.contains(&self.position_um.y)) {
            self.violate("fired outside the workpiece");
        }
        if self.position_um.distance(self.heading_um) > TOLERANCE_UM {
            self.violate("fired while moving");
        }
        if self.position_um.distance(self.commanded_um) > TOLERANCE_UM {
            self.violate("fired out of tolerance");
        }
        // No two marks of the world are equal.
        let radius_px = RADIUS_PX + 0.5 * (self.marks.len() as f64 * 0.618).fract();
        let position = self.position_um + self.landing_error_px + displacement_px;
        self.marks.push(Pulse { position, radius_px });
    }
}

/// One process and its drivers; after its death they do nothing any more.
pub(crate) struct Process {
    world: SharedWorld,
    id: u64,
    pub(crate) stop: Arc<AtomicBool>,
}

impl Process {
    pub(crate) fn drivers(&self) -> Drivers<WildStage, WildLaser, WildCamera> {
        let driver = || Driver { world: self.world.clone(), process: self.id };
        Drivers {
            stage: WildStage(driver()),
            laser: WildLaser(driver()),
            camera: WildCamera(driver()),
        }
    }
}

struct Driver {
    world: SharedWorld,
    process: u64,
}

impl Drop for Driver {
    fn drop(&mut self) {
        let mut world = self.world.lock();
        if world.process == self.process {
            world.drivers_alive -= 1;
        }
    }
}

impl Driver {
    /// The world, as long as the process lives.
    fn world(&self, device: Device) -> Result<MutexGuard<'_, World>, Fault> {
        let world = self.world.lock();
        if world.dead || world.process != self.process {
            return Err(Fault::new(device, FaultKind::Disconnected, "the process is dead"));
        }
        Ok(world)
    }

    /// Does `act` in the world, unless something goes wrong with it; `lie` does what a lie leaves.
    fn call<R>(
        &self,
        device: Device,
        name: &'static str,
        lies: &[Injection],
        act: impl Fn(&mut World, Option<Injection>) -> R,
    ) -> Result<R, Fault> {
        let failed = || Fault::new(device, FaultKind::Other, format!("{name} failed"));
        let mut world = self.world(device)?;
        let injection = match world.draw(name, lies) {
            // Nothing can disarm a laser that never listens.
            Some(Interrupts) => {
                world.stop.store(true, Ordering::SeqCst);
                None
            }
            Some(injection) if name == "disarm" => {
                let again = std::mem::replace(&mut world.disarm_failed, true);
                (!again).then_some(injection)
            }
            injection => injection,
        };
        match injection {
            None => Ok(act(&mut world, None)),
            Some(lie @ (Lies | LiesOtherwise | LiesDifferently)) => Ok(act(&mut world, Some(lie))),
            Some(Fails) => Err(failed()),
            Some(FailsAfterwards) => {
                act(&mut world, None);
                Err(failed())
            }
            Some(Dies) => {
                world.die();
                Err(failed())
            }
            Some(DiesAfterwards) => {
                act(&mut world, None);
                world.die();
                Err(failed())
            }
            Some(Hangs) => {
                drop(world);
                thread::sleep(HANG);
                Err(failed())
            }
            Some(HangsFirst | Interrupts) => {
                drop(world);
                thread::sleep(HANG);
                Ok(act(&mut *self.world(device)?, None))
            }
            Some(Panics) => {
                drop(world);
                std::panic::resume_unwind(Box::new("a driver panics on purpose"));
            }
        }
    }
}

/// A stage that may stop elsewhere, come back too early, or say something else.
pub(crate) struct WildStage(Driver);

impl Stage for WildStage {
    type Error = Fault;

    fn limits_um(&self) -> StageLimits {
        let (least_um, most_um) = (Point::new(-10.0, -10.0), Point::new(110.0, 110.0));
        StageLimits { least_um, most_um }
    }

    fn move_to(&mut self, goal_um: Point) -> Result<(), Fault> {
        self.0.call(Device::Stage, "move_to", &[Lies, LiesOtherwise], |world, lie| {
            world.commanded_um = goal_um;
            match lie {
                Some(Lies) => {
                    let off_um = Point::new(1.0 + 20.0 * world.uniform(), 0.0);
                    (world.position_um, world.heading_um) = (goal_um + off_um, goal_um + off_um);
                }
                Some(_) => {
                    world.position_um = world.position_um * 0.5 + goal_um * 0.5;
                    world.heading_um = goal_um;
                }
                None => (world.position_um, world.heading_um) = (goal_um, goal_um),
            }
        })
    }

    fn position_um(&mut self) -> Result<Point, Fault> {
        self.0.call(Device::Stage, "position_um", &[Lies, LiesOtherwise], |world, lie| {
            world.position_um = world.position_um * 0.3 + world.heading_um * 0.7;
            match lie {
                Some(Lies) => Point::new(f64::NAN, 0.0),
                Some(_) => world.position_um + Point::new(0.0, 1.0 + 20.0 * world.uniform()),
                None => world.position_um,
            }
        })
    }

    fn home(&mut self) -> Result<(), Fault> {
        self.0.call(Device::Stage, "home", &[], |world, _| {
            (world.position_um, world.heading_um) = (Point::default(), Point::default());
            world.commanded_um = Point::default();
        })
    }

    fn stop(&mut self) -> Result<(), Fault> {
        self.0.call(Device::Stage, "stop", &[], |world, _| world.heading_um = world.position_um)
    }
}

/// A laser that may not fire though it says so, fire twice, or fire elsewhere.
pub(crate) struct WildLaser(Driver);

impl Laser for WildLaser {
    type Error = Fault;

    fn arm(&mut self) -> Result<(), Fault> {
        self.0.call(Device::Laser, "arm", &[Lies], |world, lie| world.armed = lie.is_none())
    }

    fn fire(&mut self) -> Result<(), Fault> {
        let lies = [Lies, LiesOtherwise, LiesDifferently];
        self.0.call(Device::Laser, "fire", &lies, |world, lie| {
            if !world.armed || lie == Some(Lies) {
                return;
            }
            if lie == Some(LiesOtherwise) {
                world.pulse(Point::default());
            }
            let away = if lie == Some(LiesDifferently) { 6.0 } else { 0.0 };
            let away_px = Point::new(away * world.uniform(), -away * world.uniform());
            world.pulse(away_px);
        })
    }

    fn disarm(&mut self) -> Result<(), Fault> {
        self.0.call(Device::Laser, "disarm", &[], |world, _| world.armed = false)
    }
}

/// A camera whose frames tell the number of marks, and may be old or of another size.
pub(crate) struct WildCamera(Driver);

impl Camera for WildCamera {
    type Error = Fault;

    fn set_exposure_s(&mut self, _: f64) -> Result<(), Fault> {
        self.0.call(Device::Camera, "set_exposure_s", &[], |_, _| ())
    }

    fn frame(&mut self) -> Result<Frame, Fault> {
        let lies = [Lies, LiesOtherwise, LiesDifferently];
        let frame = self.0.call(Device::Camera, "frame", &lies, |world, lie| {
            if world.position_um.distance(IMAGING_UM) > TOLERANCE_UM {
                world.violate("a frame was taken elsewhere");
            }
            let now = Instant::now();
            let (marks, side, taken_at) = match lie {
                Some(Lies) => (0, 8, now.checked_sub(Duration::from_secs(1)).unwrap_or(now)),
                Some(LiesOtherwise) => (world.marks.len(), 9 + world.at_most(20), now),
                Some(_) => (world.marks.len(), 8, now + Duration::from_secs(60)),
                None => (world.marks.len(), 8, now),
            };
            let mut gray = vec![7; side * side];
            gray[..8].copy_from_slice(&(marks as u64).to_le_bytes());
            Frame::new(side, side, gray, taken_at)
        })?;
        frame.map_err(|error| Fault::new(Device::Camera, FaultKind::Protocol, error.to_string()))
    }
}

/// Reads the truth from the frames, but may be uncertain, fail, or say what cannot be.
pub(crate) struct TruthfulObserver {
    pub(crate) world: SharedWorld,
}

fn count(frame: &Frame) -> usize {
    let bytes = frame.gray().first_chunk().copied().unwrap_or_default();
    u64::from_le_bytes(bytes) as usize
}

impl Observer for TruthfulObserver {
    fn observe(
        &mut self,
        before: &Frame,
        after: &Frame,
        aimed_px: Point,
    ) -> Result<Observation, ObserverError> {
        let mut world = self.world.lock();
        let refused = || ObserverError::Registration { reason: "too dark".to_owned() };
        let lies = [Lies, LiesOtherwise, LiesDifferently];
        let injection = world.draw_from("observe", &[Fails, Dies], &lies);
        let new = world.marks.get(count(before)..count(after)).ok_or_else(refused)?.to_vec();
        let mut marks: Vec<Mark> = new
            .iter()
            .map(|&Pulse { position: center_px, radius_px }| Mark {
                center_px,
                radius_px,
                confidence: 0.99,
            })
            .collect();
        let mut verdict = if marks.is_empty() { Verdict::Nothing } else { Verdict::Seen };
        match injection {
            Some(Dies | DiesAfterwards) => {
                world.die();
                return Err(refused());
            }
            Some(Fails) => return Err(refused()),
            Some(Lies) => verdict = Verdict::Uncertain,
            Some(LiesOtherwise) => {
                let center_px = Point::new(f64::NAN, aimed_px.y);
                verdict = Verdict::Seen;
                marks.push(Mark { center_px, radius_px: 9.0, confidence: 1.0 });
            }
            Some(_) => {
                verdict = Verdict::Seen;
                marks.clear();
            }
            None => {}
        }
        Ok(Observation { verdict, marks, shift_px: Point::default() })
    }
}
