//! What the workpiece is to look like, drawn anew for every episode.

use crate::{AblationError, Stream, Workpiece, random_shape, star};
use lasergym_geom::Bitmap;

/// A machining task: where the target of an episode comes from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Task {
    /// The upright star (section 3.1 of the paper).
    Star,
    /// The star turned by an angle uniform in [0, 360)° (section 3.2).
    RotatedStar,
    /// A random smooth shape (section 3.3).
    RandomShape,
    /// A given pattern.
    Pattern(Box<Bitmap>),
}

impl Task {
    /// The target of the next episode.
    pub fn draw(&self, stream: &mut Stream) -> Bitmap {
        match self {
            Self::Star => star(0.0),
            Self::RotatedStar => star(360.0 * stream.uniform()),
            Self::RandomShape => random_shape(stream).target,
            Self::Pattern(target) => (**target).clone(),
        }
    }

    /// The target, where it is the same in every episode.
    #[must_use]
    pub(crate) fn fixed_target(&self) -> Option<Bitmap> {
        match self {
            Self::Star => Some(star(0.0)),
            Self::Pattern(target) => Some((**target).clone()),
            Self::RotatedStar | Self::RandomShape => None,
        }
    }

    /// Checks that a pattern can be machined.
    ///
    /// # Errors
    /// [`AblationError::EmptyTarget`], [`AblationError::FullTarget`].
    pub fn validate(&self) -> Result<(), AblationError> {
        match self {
            Self::Pattern(target) => Workpiece::new(target).map(drop),
            Self::Star | Self::RotatedStar | Self::RandomShape => Ok(()),
        }
    }
}
