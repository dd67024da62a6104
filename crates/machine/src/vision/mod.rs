//! Finds the mark of each pulse in a pair of frames.
//!
//! Frames are averaged over cells of about 1 µm and divided by the lamp's light, registered against
//! the reference frame, and subtracted. Circles are looked for in the difference by a Hough
//! transform along its gradients (Kimme et al. 1975), and each is refined by robust least squares
//! on the difference itself, which knows that ground is machined only once: a crescent beside an
//! earlier mark has the centre of its whole disc.

mod cells;
mod change;
mod disc_fit;
mod disc_search;
mod hough;
mod lamp;
mod options;
mod registration;
mod seeing;

pub use options::VisionOptions;
pub use seeing::Vision;
