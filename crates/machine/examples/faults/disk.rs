//! A disk that may fail or lose power while it writes.

use std::collections::BTreeMap;
use std::io;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use lasergym_machine::JobStorage;

use crate::world::{Injection, SharedWorld, World};

/// What can go wrong with a write.
const WRITES: [Injection; 5] = [
    Injection::Fails,
    Injection::FailsAfterwards,
    Injection::Dies,
    Injection::DiesAfterwards,
    Injection::Lies,
];

#[derive(Debug, Default)]
struct Contents {
    journal: Vec<u8>,
    /// Bytes of the journal that survive a power loss.
    durable: usize,
    frames: BTreeMap<String, Vec<u8>>,
}

/// A disk, shared by the processes that come and go.
#[derive(Debug, Clone)]
pub(crate) struct Disk {
    contents: Arc<Mutex<Contents>>,
    world: SharedWorld,
}

impl Disk {
    pub(crate) fn new(world: &SharedWorld) -> Self {
        Self { contents: Arc::default(), world: world.clone() }
    }

    fn lock(&self) -> MutexGuard<'_, Contents> {
        self.contents.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Loses some of what was not durable: all, nothing or the middle of a line.
    pub(crate) fn lose_power(&self) {
        let mut contents = self.lock();
        let open = contents.journal.len() - contents.durable;
        let kept = contents.durable + self.world.lock().at_most(open);
        contents.journal.truncate(kept);
    }

    /// Changes or cuts the journal somewhere behind its first line.
    pub(crate) fn decay(&self) {
        let mut contents = self.lock();
        let Some(first) = contents.journal.iter().position(|&byte| byte == b'\n') else { return };
        let behind = contents.journal.len() - first - 1;
        if behind == 0 {
            return;
        }
        let mut world = self.world.lock();
        let place = first + 1 + world.at_most(behind - 1);
        if world.uniform() < 0.5 {
            contents.journal.truncate(place);
        } else {
            contents.journal[place] ^= 1 << world.at_most(7);
        }
        contents.durable = contents.journal.len();
    }

    /// A new disk in the place of this one.
    pub(crate) fn clear(&self) {
        *self.lock() = Contents::default();
    }
}

fn broken() -> io::Error {
    io::Error::other("the disk fails")
}

fn living(world: &World) -> io::Result<()> {
    if world.is_dead() { Err(io::Error::other("the process is dead")) } else { Ok(()) }
}

impl JobStorage for Disk {
    fn name(&self) -> String {
        "the disk".to_owned()
    }

    fn read_journal(&self) -> io::Result<Vec<u8>> {
        Ok(self.lock().journal.clone())
    }

    fn append(&mut self, line: &[u8], durable: bool) -> io::Result<()> {
        let mut contents = self.lock();
        let mut world = self.world.lock();
        living(&world)?;
        let injection = world.draw_from("append", &WRITES, &[]);
        let torn = world.at_most(line.len() - 1);
        match injection {
            Some(Injection::Fails) => return Err(broken()),
            Some(Injection::FailsAfterwards) => {
                contents.journal.extend(&line[..torn]);
                return Err(broken());
            }
            Some(Injection::Dies) => {
                contents.journal.extend(&line[..torn]);
                world.die();
                return Err(broken());
            }
            Some(Injection::DiesAfterwards) => {
                contents.journal.extend(line);
                world.die();
                return Err(broken());
            }
            // Written, but the process never hears of it.
            Some(_) => {
                contents.journal.extend(line);
                return Err(broken());
            }
            None => contents.journal.extend(line),
        }
        if durable {
            contents.durable = contents.journal.len();
        }
        Ok(())
    }

    fn cut_journal(&mut self, intact_bytes: u64) -> io::Result<()> {
        let mut contents = self.lock();
        contents.journal.truncate(intact_bytes as usize);
        contents.durable = contents.journal.len();
        Ok(())
    }

    fn save_frame(&mut self, name: &str, png: &[u8]) -> io::Result<()> {
        let mut contents = self.lock();
        let mut world = self.world.lock();
        living(&world)?;
        let injection = world.draw_from("save_frame", &WRITES, &[]);
        match injection {
            Some(Injection::Fails | Injection::FailsAfterwards) => return Err(broken()),
            Some(Injection::Dies) => {
                world.die();
                return Err(broken());
            }
            _ => {}
        }
        contents.frames.insert(name.to_owned(), png.to_vec());
        match injection {
            None => Ok(()),
            Some(injection) => {
                if injection == Injection::DiesAfterwards {
                    world.die();
                }
                Err(broken())
            }
        }
    }

    fn load_frame(&self, name: &str) -> io::Result<Vec<u8>> {
        self.lock().frames.get(name).cloned().ok_or_else(|| io::ErrorKind::NotFound.into())
    }
}
