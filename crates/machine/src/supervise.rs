//! Drivers that may hang: each works on a thread of its own and has to answer in time.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::thread;
use std::time::Duration;

use lasergym_geom::Point;

use crate::{
    Camera, Device, DriverError, Fault, FaultKind, Frame, JobError, Laser, Stage, StageLimits,
};

/// How long calls of drivers may take.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Deadlines {
    /// Homing the stage. Default 60 s.
    pub home: Duration,
    /// A move of the stage until it has settled. Default 30 s.
    pub move_to: Duration,
    /// Reading the position of the stage, and stopping it. Default 2 s.
    pub stage: Duration,
    /// Arming, firing, disarming. Default 2 s.
    pub laser: Duration,
    /// A frame, or a new exposure time. Default 5 s.
    pub camera: Duration,
}

impl Default for Deadlines {
    fn default() -> Self {
        Self {
            home: Duration::from_secs(60),
            move_to: Duration::from_secs(30),
            stage: Duration::from_secs(2),
            laser: Duration::from_secs(2),
            camera: Duration::from_secs(5),
        }
    }
}

/// How often a driver is asked to leave its device safe when it is let go.
const LAST_TRIES: usize = 3;

/// A call that waits for its driver.
type Call<D> = Box<dyn FnOnce(&mut D) + Send>;

/// A driver on a thread of its own, itself a driver whose errors are [`Fault`]s.
///
/// A call that misses its deadline is a [`FaultKind::Timeout`], and the device is lost: all further
/// calls fail at once. When the driver comes back after all, and also when it is dropped, its thread
/// disarms the laser or stops the stage as the last thing it does, in several tries if need be. Nothing can disarm a laser whose
/// driver hangs for good: that takes an interlock in hardware. A driver that panics has failed with
/// [`FaultKind::Other`] and is asked again.
#[derive(Debug)]
pub struct Supervised<D> {
    device: Device,
    deadlines: Deadlines,
    limits_um: Option<StageLimits>,
    /// `None` when the device is lost.
    calls: Option<Sender<Call<D>>>,
    ended: Receiver<()>,
}

impl<D: Send + 'static> Supervised<D> {
    fn start(
        mut driver: D,
        device: Device,
        deadlines: Deadlines,
        limits_um: Option<StageLimits>,
        last: impl Fn(&mut D) -> bool + Send + 'static,
    ) -> Result<Self, JobError> {
        let (calls, waiting) = mpsc::channel::<Call<D>>();
        let (end, ended) = mpsc::channel();
        let work = move || {
            for call in waiting {
                call(&mut driver);
            }
            for _ in 0..LAST_TRIES {
                if matches!(catch_unwind(AssertUnwindSafe(|| last(&mut driver))), Ok(true)) {
                    break;
                }
            }
            drop(driver);
            let _ = end.send(());
        };
        thread::Builder::new()
            .name(device.to_string())
            .spawn(work)
            .map_err(|error| JobError::Thread { device, reason: error.to_string() })?;
        Ok(Self { device, deadlines, limits_um, calls: Some(calls), ended })
    }

    /// Lets the driver work on `call` until `deadline`.
    fn call<R, E>(
        &mut self,
        deadline: Duration,
        what: &str,
        call: impl FnOnce(&mut D) -> Result<R, E> + Send + 'static,
    ) -> Result<R, Fault>
    where
        R: Send + 'static,
        E: DriverError,
    {
        let device = self.device;
        let (reply, answer) = mpsc::channel();
        let waiting: Call<D> = Box::new(move |driver| {
            let result = match catch_unwind(AssertUnwindSafe(|| call(driver))) {
                Ok(Ok(value)) => Ok(value),
                Ok(Err(error)) => Err(Fault::of(device, &error)),
                Err(_) => Err(Fault::new(device, FaultKind::Other, "its driver panicked")),
            };
            let _ = reply.send(result);
        });
        let sent = self.calls.as_ref().is_some_and(|calls| calls.send(waiting).is_ok());
        if !sent {
            let message = format!("it is lost since an earlier call, so there is no {what}");
            return Err(Fault::new(device, FaultKind::Disconnected, message));
        }
        match answer.recv_timeout(deadline) {
            Ok(result) => result,
            Err(RecvTimeoutError::Timeout) => {
                self.calls = None;
                let message = format!("{what} took longer than {} s", deadline.as_secs_f64());
                Err(Fault::new(device, FaultKind::Timeout, message))
            }
            Err(RecvTimeoutError::Disconnected) => {
                self.calls = None;
                Err(Fault::new(device, FaultKind::Disconnected, "its thread has ended"))
            }
        }
    }
}

impl<D> Drop for Supervised<D> {
    /// Waits for the last thing that the driver does, but not for one that hangs.
    fn drop(&mut self) {
        if self.calls.take().is_some() {
            let _ = self.ended.recv_timeout(self.deadlines.stage.max(self.deadlines.laser));
        }
    }
}

impl<S: Stage> Supervised<S> {
    /// Puts a stage on a thread of its own, which stops it in the end.
    ///
    /// # Errors
    /// [`JobError::Thread`].
    pub fn stage(stage: S, deadlines: Deadlines) -> Result<Self, JobError> {
        let limits_um = Some(stage.limits_um());
        Self::start(stage, Device::Stage, deadlines, limits_um, |stage| stage.stop().is_ok())
    }
}

impl<L: Laser> Supervised<L> {
    /// Puts a laser on a thread of its own, which disarms it in the end.
    ///
    /// # Errors
    /// [`JobError::Thread`].
    pub fn laser(laser: L, deadlines: Deadlines) -> Result<Self, JobError> {
        Self::start(laser, Device::Laser, deadlines, None, |laser| laser.disarm().is_ok())
    }
}

impl<C: Camera> Supervised<C> {
    /// Puts a camera on a thread of its own.
    ///
    /// # Errors
    /// [`JobError::Thread`].
    pub fn camera(camera: C, deadlines: Deadlines) -> Result<Self, JobError> {
        Self::start(camera, Device::Camera, deadlines, None, |_| true)
    }
}

impl<S: Stage> Stage for Supervised<S> {
    type Error = Fault;

    fn limits_um(&self) -> StageLimits {
        let nowhere = Point::new(f64::NAN, f64::NAN);
        self.limits_um.unwrap_or(StageLimits { least_um: nowhere, most_um: nowhere })
    }

    fn move_to(&mut self, position_um: Point) -> Result<(), Fault> {
        self.call(self.deadlines.move_to, "a move", move |stage| stage.move_to(position_um))
    }

    fn position_um(&mut self) -> Result<Point, Fault> {
        self.call(self.deadlines.stage, "a position", S::position_um)
    }

    fn home(&mut self) -> Result<(), Fault> {
        self.call(self.deadlines.home, "homing", S::home)
    }

    fn stop(&mut self) -> Result<(), Fault> {
        self.call(self.deadlines.stage, "a stop", S::stop)
    }
}

impl<L: Laser> Laser for Supervised<L> {
    type Error = Fault;

    fn arm(&mut self) -> Result<(), Fault> {
        self.call(self.deadlines.laser, "arming", L::arm)
    }

    fn fire(&mut self) -> Result<(), Fault> {
        self.call(self.deadlines.laser, "a pulse", L::fire)
    }

    fn disarm(&mut self) -> Result<(), Fault> {
        self.call(self.deadlines.laser, "disarming", L::disarm)
    }
}

impl<C: Camera> Camera for Supervised<C> {
    type Error = Fault;

    fn set_exposure_s(&mut self, exposure_s: f64) -> Result<(), Fault> {
        let call = move |camera: &mut C| camera.set_exposure_s(exposure_s);
        self.call(self.deadlines.camera, "an exposure time", call)
    }

    fn frame(&mut self) -> Result<Frame, Fault> {
        self.call(self.deadlines.camera, "a frame", C::frame)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::{Arc, Mutex};

    /// Writes down what it is told to do, and hangs or panics when it fires.
    struct Diary {
        entries: Arc<Mutex<Vec<&'static str>>>,
        hang: Duration,
        panics: bool,
    }

    impl Laser for Diary {
        type Error = Fault;

        fn arm(&mut self) -> Result<(), Fault> {
            Err(Fault::new(Device::Laser, FaultKind::Interlock, "the door is open"))
        }

        fn fire(&mut self) -> Result<(), Fault> {
            if self.panics {
                std::panic::resume_unwind(Box::new("on purpose"));
            }
            thread::sleep(self.hang);
            self.entries.lock().unwrap().push("fire");
            Ok(())
        }

        fn disarm(&mut self) -> Result<(), Fault> {
            self.entries.lock().unwrap().push("disarm");
            Ok(())
        }
    }

    fn diary(hang_ms: u64, panics: bool) -> (Supervised<Diary>, Arc<Mutex<Vec<&'static str>>>) {
        let entries = Arc::new(Mutex::new(Vec::new()));
        let hang = Duration::from_millis(hang_ms);
        let laser = Diary { entries: Arc::clone(&entries), hang, panics };
        let deadline = if hang_ms > 0 { 100 } else { 30_000 };
        let deadlines =
            Deadlines { laser: Duration::from_millis(deadline), ..Deadlines::default() };
        (Supervised::laser(laser, deadlines).unwrap(), entries)
    }

    #[test]
    fn answers_and_errors_of_the_driver_arrive() {
        let (mut laser, entries) = diary(0, false);
        assert_eq!(laser.fire(), Ok(()));
        assert_eq!(laser.arm().unwrap_err().kind, FaultKind::Interlock);
        drop(laser);
        assert_eq!(*entries.lock().unwrap(), ["fire", "disarm"]);
    }

    #[test]
    fn a_device_that_hangs_is_lost_and_disarmed_when_it_comes_back() {
        let (mut laser, entries) = diary(600, false);
        assert_eq!(laser.fire().unwrap_err().kind, FaultKind::Timeout);
        assert_eq!(laser.disarm().unwrap_err().kind, FaultKind::Disconnected);
        assert!(entries.lock().unwrap().is_empty());
        laser.ended.recv().unwrap();
        assert_eq!(*entries.lock().unwrap(), ["fire", "disarm"]);
    }

    #[test]
    fn a_driver_that_panics_is_a_fault_and_can_still_be_disarmed() {
        let (mut laser, entries) = diary(0, true);
        assert_eq!(laser.fire().unwrap_err().kind, FaultKind::Other);
        assert_eq!(laser.disarm(), Ok(()));
        assert_eq!(*entries.lock().unwrap(), ["disarm"]);
    }
}
