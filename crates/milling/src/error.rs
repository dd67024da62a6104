//! What can go wrong with depth milling.

/// Every error of this crate. Rows, columns, passes and points count from 0, lines of files from 1.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MillingError {
    /// An option lies outside its range.
    #[error("{name} is {value}, but must be {expected}")]
    InvalidOption {
        /// Name of the option, unit included.
        name: &'static str,
        /// The value given.
        value: f64,
        /// What is accepted.
        expected: &'static str,
    },
    /// A grid or a height map is empty or too large.
    #[error("a grid of {rows} × {columns} cells: give at least 1 × 1 and at most {limit} cells")]
    GridSize {
        /// Rows asked for.
        rows: usize,
        /// Columns asked for.
        columns: usize,
        /// Most cells that are accepted.
        limit: usize,
    },
    /// An array has the wrong number of entries.
    #[error("{name} has {actual} entries, but {expected} are needed")]
    WrongLength {
        /// Name of the array.
        name: &'static str,
        /// Entries given.
        actual: usize,
        /// Entries needed.
        expected: usize,
    },
    /// A value of a target is not a finite depth.
    #[error(
        "the target is {value} at row {row}, column {column}: depths must be finite, at least 0 and at most 1e6 µm"
    )]
    TargetValue {
        /// Row of the cell.
        row: usize,
        /// Column of the cell.
        column: usize,
        /// The value there, µm.
        value: f64,
    },
    /// A target with nothing to remove.
    #[error("the target is 0 µm deep everywhere: there is nothing to remove")]
    EmptyTarget,
    /// A measured surface that does not lie over the target.
    #[error(
        "the measured surface is {measured_width_um} × {measured_height_um} µm, but the target is {width_um} × {height_um} µm: measure the whole target and nothing beside it"
    )]
    MeasuredSize {
        /// Width of the target, µm.
        width_um: f64,
        /// Height of the target, µm.
        height_um: f64,
        /// Width of the measured surface, µm.
        measured_width_um: f64,
        /// Height of the measured surface, µm.
        measured_height_um: f64,
    },
    /// The target is deeper than the passes can reach.
    #[error(
        "{depth_um} µm are to be removed at row {row}, column {column}, but {layers} layers reach {reach_um} µm: allow {needed} layers"
    )]
    TooDeep {
        /// Row of the deepest cell.
        row: usize,
        /// Column of the deepest cell.
        column: usize,
        /// What is to be removed there, µm.
        depth_um: f64,
        /// Layers allowed.
        layers: usize,
        /// Depth that they reach at the lowest speed, µm.
        reach_um: f64,
        /// Layers that would do.
        needed: usize,
    },
    /// The target is shallower than the fastest pass leaves, and the beam cannot be switched off.
    #[error(
        "the target is {depth_um} µm deep at row {row}, column {column}, but the fastest pass removes {least_um} µm and the beam cannot be switched off: add a base depth or allow a higher speed"
    )]
    TooShallow {
        /// Row of the shallowest cell.
        row: usize,
        /// Column of the shallowest cell.
        column: usize,
        /// Its depth, µm.
        depth_um: f64,
        /// Depth at the highest speed, µm.
        least_um: f64,
    },
    /// Cells that are too coarse for the beam.
    #[error(
        "cells of {cell_um} µm are too coarse for a footprint of {diameter_um} µm diameter: refine the grid to {largest_um} µm or less"
    )]
    GridTooCoarse {
        /// Side of a cell, µm.
        cell_um: f64,
        /// Diameter of the footprint, µm.
        diameter_um: f64,
        /// Largest side that is accepted, µm.
        largest_um: f64,
    },
    /// The footprint covers too many cells at once.
    #[error(
        "the footprint covers {cells} × {cells} cells, more than {limit} × {limit}: use larger cells"
    )]
    WindowTooLarge {
        /// Cells along a side of the window.
        cells: usize,
        /// Most that are accepted.
        limit: usize,
    },
    /// The beam leaves the grid.
    #[error(
        "in pass {pass} the footprint at ({x_um}, {y_um}) µm leaves the grid: keep a margin of {margin_um} µm around the passes"
    )]
    BeamLeavesGrid {
        /// The pass.
        pass: usize,
        /// x of the beam, µm.
        x_um: f64,
        /// y of the beam, µm.
        y_um: f64,
        /// Margin that is needed, µm.
        margin_um: f64,
    },
    /// A control of a path is not usable.
    #[error("{name} of point {point} in pass {pass} is {value}: it must be {expected}")]
    Control {
        /// Name of the control, unit included.
        name: &'static str,
        /// The pass.
        pass: usize,
        /// The point in the pass.
        point: usize,
        /// The value.
        value: f64,
        /// What is accepted.
        expected: &'static str,
    },
    /// A spot is not usable.
    #[error("{name} of spot {index} is {value}: it must be {expected}")]
    Spot {
        /// Index of the spot.
        index: usize,
        /// Name of the value, unit included.
        name: &'static str,
        /// The value.
        value: f64,
        /// What is accepted.
        expected: &'static str,
    },
    /// An action has a component that is not a number or infinite.
    #[error(
        "action of environment {environment} is ({x}, {y}, {dwell}): its components must be finite, in [-1, 1]"
    )]
    ActionNotFinite {
        /// Index of the environment.
        environment: usize,
        /// First component.
        x: f32,
        /// Second component.
        y: f32,
        /// Third component.
        dwell: f32,
    },
    /// A batch of environments cannot be made or stepped.
    #[error(transparent)]
    Batch(#[from] lasergym_batch::BatchError),
    /// A step removes so much that the surface would ripple.
    #[error(
        "the step is unstable: its Courant number is {courant}, above {limit}; use at least {substeps} substeps per point"
    )]
    Unstable {
        /// Courant number of the largest step.
        courant: f64,
        /// Largest that is accepted.
        limit: f64,
        /// Substeps that would do.
        substeps: usize,
    },
    /// A table of a footprint is not usable.
    #[error(
        "entry {index} of the footprint table is {value}: rates must be finite and at least 0, and the first above 0"
    )]
    FootprintTable {
        /// Index of the entry.
        index: usize,
        /// The value, µm/s.
        value: f64,
    },
    /// A process profile cannot be read.
    #[error("the process profile cannot be read: {reason}")]
    Profile {
        /// What is wrong, with line and column where known.
        reason: String,
    },
    /// A name that no shipped profile has.
    #[error(
        "there is no process named {name:?}: use one of {accepted}, or the name of a TOML file"
    )]
    UnknownProfile {
        /// The name given.
        name: String,
        /// The names there are.
        accepted: String,
    },
    /// Trenches that do not determine a process.
    #[error("the trenches cannot be fitted ({reason}): measure more or other trenches")]
    Calibration {
        /// What is missing.
        reason: String,
    },
    /// A trench file cannot be read.
    #[error("line {line}: {reason}")]
    TrenchFile {
        /// Number of the line.
        line: usize,
        /// What is wrong.
        reason: String,
    },
    /// A file whose name does not say which heights it holds.
    #[error("{name} must end in one of .npy, .asc, .dem, .png, .tif, .tiff, .stl")]
    HeightFormat {
        /// The name.
        name: String,
    },
    /// A file of heights that cannot be read.
    #[error("the {format} file cannot be read: {reason}")]
    HeightFile {
        /// Which kind of file it should be.
        format: &'static str,
        /// What is wrong with it.
        reason: String,
    },
    /// A height that is not finite.
    #[error("the height at row {row}, column {column} is {value}: heights must be finite")]
    HeightValue {
        /// Row of the cell.
        row: usize,
        /// Column of the cell.
        column: usize,
        /// The value there.
        value: f64,
    },
}

/// Checks `value` of the option `name`.
pub(crate) fn check_option(
    name: &'static str,
    value: f64,
    ok: bool,
    expected: &'static str,
) -> Result<(), MillingError> {
    if ok { Ok(()) } else { Err(MillingError::InvalidOption { name, value, expected }) }
}
