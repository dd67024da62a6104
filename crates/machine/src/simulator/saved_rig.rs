//! A rig that outlives the process: its world is kept in a file.

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use lasergym_geom::Point;

use super::{
    Rig, SimulatedCamera, SimulatedError, SimulatedLaser, SimulatedStage, SimulatorOptions,
};
use crate::{Camera, DriverError, FaultKind, Frame, Laser, Stage, StageLimits};

/// Most bytes of the file of a rig.
const MAX_FILE_BYTES: u64 = 64 << 20;

/// A rig whose world is written to a file after whatever happens to it, as a real workpiece keeps
/// what was done to it when the process that moved it dies.
#[derive(Debug, Clone)]
pub struct SavedRig {
    rig: Rig,
    path: PathBuf,
}

/// Every error of a saved rig.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SavedRigError {
    /// The rig refuses.
    #[error(transparent)]
    Simulated(#[from] SimulatedError),
    /// The file cannot be read or written.
    #[error("the file of the simulated rig, {path}, cannot be used: {source}")]
    File {
        /// The file.
        path: String,
        /// What the system said.
        source: io::Error,
    },
    /// The file is none of a rig.
    #[error("{path} does not hold a simulated rig: {reason}")]
    Content {
        /// The file.
        path: String,
        /// What does not fit.
        reason: String,
    },
}

impl DriverError for SavedRigError {
    fn kind(&self) -> FaultKind {
        match self {
            Self::Simulated(error) => error.kind(),
            Self::File { .. } | Self::Content { .. } => FaultKind::Other,
        }
    }
}

impl SavedRig {
    /// A fresh workpiece in a rig with the errors `options`, kept in the file `path`.
    ///
    /// # Errors
    /// As [`Rig::new`], and when the file cannot be written.
    pub fn create(
        path: impl Into<PathBuf>,
        options: SimulatorOptions,
        seed: u64,
    ) -> Result<Self, SavedRigError> {
        let rig = Self { rig: Rig::new(options, seed)?, path: path.into() };
        rig.save()?;
        Ok(rig)
    }

    /// The rig in the file `path`.
    ///
    /// # Errors
    /// As [`Rig::from_state`], and when the file cannot be read or is none of a rig.
    pub fn open(path: impl Into<PathBuf>) -> Result<Self, SavedRigError> {
        let path = path.into();
        let content = read(&path).map_err(|source| file_error(&path, source))?;
        let state = serde_json::from_slice(&content).map_err(|error| SavedRigError::Content {
            path: path.display().to_string(),
            reason: error.to_string(),
        })?;
        Ok(Self { rig: Rig::from_state(state)?, path })
    }

    /// The rig itself; what is done to it directly is not saved.
    #[must_use]
    pub fn rig(&self) -> &Rig {
        &self.rig
    }

    /// Its stage.
    #[must_use]
    pub fn stage(&self) -> Saved<SimulatedStage> {
        Saved { device: self.rig.stage(), rig: self.clone() }
    }

    /// Its laser.
    #[must_use]
    pub fn laser(&self) -> Saved<SimulatedLaser> {
        Saved { device: self.rig.laser(), rig: self.clone() }
    }

    /// Its camera.
    #[must_use]
    pub fn camera(&self) -> Saved<SimulatedCamera> {
        Saved { device: self.rig.camera(), rig: self.clone() }
    }

    /// Writes the world; the file holds the world before or after, whatever happens meanwhile.
    fn save(&self) -> Result<(), SavedRigError> {
        let content =
            serde_json::to_vec(&self.rig.state()).map_err(|error| SavedRigError::Content {
                path: self.path.display().to_string(),
                reason: error.to_string(),
            })?;
        replace(&self.path, &content).map_err(|source| file_error(&self.path, source))
    }
}

fn file_error(path: &Path, source: io::Error) -> SavedRigError {
    SavedRigError::File { path: path.display().to_string(), source }
}

fn read(path: &Path) -> io::Result<Vec<u8>> {
    let length = fs::metadata(path)?.len();
    if length > MAX_FILE_BYTES {
        return Err(io::Error::other(format!("it has {length} bytes")));
    }
    fs::read(path)
}

fn replace(path: &Path, content: &[u8]) -> io::Result<()> {
    let part = path.with_extension("part");
    let mut file = File::create(&part)?;
    file.write_all(content)?;
    file.sync_data()?;
    fs::rename(&part, path)
}

/// A device of a [`SavedRig`].
#[derive(Debug, Clone)]
pub struct Saved<D> {
    device: D,
    rig: SavedRig,
}

impl<D> Saved<D> {
    /// Does something with the device and saves what has become of the rig.
    fn with<T>(
        &mut self,
        act: impl FnOnce(&mut D) -> Result<T, SimulatedError>,
    ) -> Result<T, SavedRigError> {
        let done = act(&mut self.device)?;
        self.rig.save()?;
        Ok(done)
    }
}

impl Stage for Saved<SimulatedStage> {
    type Error = SavedRigError;

    fn limits_um(&self) -> StageLimits {
        self.device.limits_um()
    }

    fn move_to(&mut self, position_um: Point) -> Result<(), SavedRigError> {
        self.with(|stage| stage.move_to(position_um))
    }

    fn position_um(&mut self) -> Result<Point, SavedRigError> {
        Ok(self.device.position_um()?)
    }

    fn home(&mut self) -> Result<(), SavedRigError> {
        self.with(Stage::home)
    }

    fn stop(&mut self) -> Result<(), SavedRigError> {
        Ok(self.device.stop()?)
    }
}

impl Laser for Saved<SimulatedLaser> {
    type Error = SavedRigError;

    fn arm(&mut self) -> Result<(), SavedRigError> {
        Ok(self.device.arm()?)
    }

    fn fire(&mut self) -> Result<(), SavedRigError> {
        self.with(Laser::fire)
    }

    fn disarm(&mut self) -> Result<(), SavedRigError> {
        Ok(self.device.disarm()?)
    }
}

impl Camera for Saved<SimulatedCamera> {
    type Error = SavedRigError;

    fn set_exposure_s(&mut self, exposure_s: f64) -> Result<(), SavedRigError> {
        self.with(|camera| camera.set_exposure_s(exposure_s))
    }

    fn frame(&mut self) -> Result<Frame, SavedRigError> {
        self.with(Camera::frame)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulator::Preset;

    #[test]
    fn a_rig_that_is_opened_goes_on_as_it_would_have() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rig.json");
        let first = SavedRig::create(&path, Preset::Lab.options(), 7).unwrap();
        first.stage().move_to(Point::new(30.0, 40.0)).unwrap();
        first.laser().arm().unwrap();
        first.laser().fire().unwrap();
        first.laser().disarm().unwrap();
        let second = SavedRig::open(&path).unwrap();
        assert_eq!(second.rig().true_marks(), first.rig().true_marks());
        for rig in [&first, &second] {
            rig.stage().move_to(Point::new(50.0, 50.0)).unwrap();
        }
        let frames = [&first, &second].map(|rig| rig.camera().frame().unwrap().gray().to_vec());
        assert_eq!(frames[0], frames[1]);
    }

    #[test]
    fn a_file_that_is_no_rig_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rig.json");
        assert!(matches!(SavedRig::open(&path), Err(SavedRigError::File { .. })));
        for content in ["", "{}", "[1, 2]", "{\"options\": 3}"] {
            fs::write(&path, content).unwrap();
            assert!(matches!(SavedRig::open(&path), Err(SavedRigError::Content { .. })));
        }
    }
}
