//! Geometry of the workpiece: points, bit-row bitmaps and filled outlines; drawings (PNG, JPEG, SVG,
//! DXF) as targets, and pictures out.
//!
//! The workpiece is a square of [`WORKPIECE_SIZE_PX`] × [`WORKPIECE_SIZE_PX`] pixels of
//! [`PIXEL_UM`] µm. Pixel (row `j`, column `i`) has its centre at `(x, y) = (i + 0.5, j + 0.5)`;
//! x points right, y points down.

mod animation;
mod bezier;
mod bitmap;
mod drawing;
mod drawing_curves;
mod drawing_error;
mod drawing_format;
mod drawing_options;
mod dxf_curve;
mod dxf_drawing;
mod dxf_entity;
mod dxf_reader;
mod image_drawing;
mod ink_raster;
mod outline;
mod picture;
mod placement;
mod point;
mod svg_cost;
mod svg_curves;
mod svg_document;
mod svg_drawing;
mod svg_numbers;
mod svg_references;

pub use animation::animation_gif;
pub use bezier::CubicBezier;
pub use bitmap::{Bitmap, Row, row_mask};
pub use drawing::{drawing_from_bytes, load_drawing};
pub use drawing_curves::DrawingCurves;
pub use drawing_error::DrawingError;
pub use drawing_format::DrawingFormat;
pub use drawing_options::{DrawingOptions, Fit, Ink};
pub use image_drawing::{target_to_png, write_png};
pub use outline::fill_even_odd;
pub use picture::{Picture, svg_to_rgba};
pub use point::Point;

/// Width and height of the workpiece, px.
pub const WORKPIECE_SIZE_PX: usize = 100;

/// Side of one pixel, µm.
pub const PIXEL_UM: f64 = 1.0;
