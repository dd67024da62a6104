//! The curves of DXF entities, blocks inserted.

use std::{
    collections::{BTreeSet, HashMap, HashSet},
    f64::consts::PI,
};

use crate::{
    DrawingError, DrawingFormat,
    dxf_curve::{Spline, bulged_polyline, counterclockwise, ellipse_arc},
    dxf_reader::{Record, section},
};

/// What a drawing may consist of.
const SUPPORTED: &str = "LINE, ARC, CIRCLE, ELLIPSE, LWPOLYLINE, POLYLINE, SPLINE with control points, and INSERT of \
     blocks of these, all in the plane";

/// Kinds that say something about the drawing and are not part of it; they are passed over.
const NOTES: [&str; 12] = [
    "ACAD_PROXY_ENTITY",
    "ATTDEF",
    "ATTRIB",
    "DIMENSION",
    "LEADER",
    "MULTILEADER",
    "POINT",
    "RAY",
    "SEQEND",
    "TOLERANCE",
    "VIEWPORT",
    "XLINE",
];

/// Largest number of points of all curves.
const MAX_POINTS: usize = 4_000_000;

/// Largest number of group codes, those of inserted blocks counted at each insertion.
const MAX_GROUPS: usize = 4_000_000;

/// Inserting a block takes about as long as reading this many group codes.
const INSERTION_GROUPS: usize = 16;

/// What [`MAX_GROUPS`] limits, for messages.
const GROUPS: &str = "group codes once its blocks are inserted";

/// Deepest nesting of blocks.
const MAX_DEPTH: usize = 16;

/// A curve as points (x, y), drawing units, y up. Closed curves end where they begin.
pub(crate) type Curve = Vec<[f64; 2]>;

/// The curves of the model space of a file. Entities that are invisible, in paper space, or on a
/// layer that is off or frozen are passed over.
pub(crate) fn curves(records: &[Record]) -> Result<Vec<Curve>, DrawingError> {
    let mut reader = EntityReader {
        blocks: blocks(section(records, "BLOCKS")),
        hidden_layers: hidden_layers(section(records, "TABLES"))?,
        curves: Vec::new(),
        points: 0,
        groups: 0,
        unknown: BTreeSet::new(),
    };
    reader.read(section(records, "ENTITIES"), &Affine::IDENTITY, 0)?;
    if reader.unknown.is_empty() {
        return Ok(reader.curves);
    }
    Err(DrawingError::UnknownEntities {
        format: DrawingFormat::Dxf,
        kinds: reader.unknown.into_iter().collect(),
        supported: SUPPORTED,
    })
}

/// Maps (x, y) to `columns[0] x + columns[1] y + offset`.
#[derive(Debug, Clone, Copy)]
struct Affine {
    columns: [[f64; 2]; 2],
    offset: [f64; 2],
}

impl Affine {
    const IDENTITY: Self = Self { columns: [[1.0, 0.0], [0.0, 1.0]], offset: [0.0; 2] };
    const MIRROR: Self = Self { columns: [[-1.0, 0.0], [0.0, 1.0]], offset: [0.0; 2] };

    fn apply(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|axis| self.columns[0][axis] * x + self.columns[1][axis] * y + self.offset[axis])
    }

    /// First `inner`, then `self`.
    fn after(&self, inner: &Self) -> Self {
        let origin = self.offset;
        let columns = inner.columns.map(|column| {
            let image = self.apply(column);
            [image[0] - origin[0], image[1] - origin[1]]
        });
        Self { columns, offset: self.apply(inner.offset) }
    }
}

/// A block: its base point and its entities.
struct Block<'a, 'b> {
    begin: &'b Record<'a>,
    entities: &'b [Record<'a>],
}

fn blocks<'a, 'b>(records: &'b [Record<'a>]) -> HashMap<&'a str, Block<'a, 'b>> {
    let mut blocks = HashMap::new();
    for (k, begin) in records.iter().enumerate().filter(|(_, record)| record.kind == "BLOCK") {
        let inner = &records[k + 1..];
        let end = inner.iter().position(|record| record.kind == "ENDBLK").unwrap_or(inner.len());
        if let Some(name) = begin.text(2) {
            blocks.insert(name, Block { begin, entities: &inner[..end] });
        }
    }
    blocks
}

/// Layers that are frozen (flag 1) or off (negative colour).
fn hidden_layers<'a>(tables: &[Record<'a>]) -> Result<HashSet<&'a str>, DrawingError> {
    let mut hidden = HashSet::new();
    for layer in tables.iter().filter(|record| record.kind == "LAYER") {
        if layer.flags(70)? & 1 == 1 || layer.number_or(62, 7.0)? < 0.0 {
            hidden.extend(layer.text(2));
        }
    }
    Ok(hidden)
}

struct EntityReader<'a, 'b> {
    blocks: HashMap<&'a str, Block<'a, 'b>>,
    hidden_layers: HashSet<&'a str>,
    curves: Vec<Curve>,
    points: usize,
    groups: usize,
    unknown: BTreeSet<String>,
}

impl<'a> EntityReader<'a, '_> {
    /// Reads `records`, moved by `affine`, in block depth `depth`.
    fn read(
        &mut self,
        records: &[Record<'a>],
        affine: &Affine,
        depth: usize,
    ) -> Result<(), DrawingError> {
        for (k, record) in records.iter().enumerate() {
            self.groups += record.len();
            check_limit(GROUPS, self.groups, MAX_GROUPS)?;
            let hidden = record.text(8).is_some_and(|layer| self.hidden_layers.contains(layer));
            // Vertices belong to the POLYLINE before them.
            if hidden
                || record.kind == "VERTEX"
                || NOTES.contains(&record.kind)
                || record.flags(60)? == 1
                || record.flags(67)? == 1
            {
                continue;
            }
            let placed = match Plane::of(record)? {
                Plane::Tilted => {
                    self.unknown.insert(format!("{} out of the plane", name(record)));
                    continue;
                }
                Plane::Below if is_in_own_axes(record) => affine.after(&Affine::MIRROR),
                Plane::Below | Plane::Above => *affine,
            };
            if record.kind == "INSERT" {
                self.insert(record, &placed, depth)?;
                continue;
            }
            match curve(record, &records[k + 1..])? {
                Shape::Curve(points) => self.add(&points, &placed, record)?,
                Shape::Unknown(kind) => {
                    self.unknown.insert(kind);
                }
            }
        }
        Ok(())
    }

    fn add(
        &mut self,
        points: &[[f64; 2]],
        affine: &Affine,
        record: &Record,
    ) -> Result<(), DrawingError> {
        self.points += points.len();
        check_limit("curve points", self.points, MAX_POINTS)?;
        let curve: Curve = points.iter().map(|&point| affine.apply(point)).collect();
        if curve.iter().flatten().any(|c| c.is_nan() || c.abs() > 1e15) {
            return Err(record.malformed("reaches further than 1e15 drawing units"));
        }
        self.curves.push(curve);
        Ok(())
    }

    /// Reads the block that `record` inserts, once for each place of its array.
    fn insert(
        &mut self,
        record: &Record<'a>,
        affine: &Affine,
        depth: usize,
    ) -> Result<(), DrawingError> {
        check_limit("levels of nested blocks", depth + 1, MAX_DEPTH)?;
        let block_name = record.text(2).unwrap_or_default();
        let Some(block) = self.blocks.get(block_name) else {
            return Err(record.malformed("inserts a block that the file does not have"));
        };
        let entities = block.entities;
        let base = [block.begin.number_or(10, 0.0)?, block.begin.number_or(20, 0.0)?];
        let [x, y] = record.point(10)?;
        let scale = [record.number_or(41, 1.0)?, record.number_or(42, 1.0)?];
        let (sin, cos) = record.number_or(50, 0.0)?.to_radians().sin_cos();
        let copies = [record.number_or(70, 1.0)?, record.number_or(71, 1.0)?].map(|n| n.max(1.0));
        let steps = [record.number_or(44, 0.0)?, record.number_or(45, 0.0)?];
        let insertions = (copies[0] * copies[1]) as usize;
        self.groups = self.groups.saturating_add(insertions.saturating_mul(INSERTION_GROUPS));
        check_limit(GROUPS, self.groups, MAX_GROUPS)?;
        for row in 0..copies[1] as u32 {
            for column in 0..copies[0] as u32 {
                let step = [f64::from(column) * steps[0], f64::from(row) * steps[1]];
                let turned = Affine { columns: [[cos, sin], [-sin, cos]], offset: [x, y] };
                let scaled = Affine {
                    columns: [[scale[0], 0.0], [0.0, scale[1]]],
                    offset: [step[0] - scale[0] * base[0], step[1] - scale[1] * base[1]],
                };
                let placed = affine.after(&turned.after(&scaled));
                self.read(entities, &placed, depth + 1)?;
            }
        }
        Ok(())
    }
}

/// What an entity draws.
enum Shape {
    Curve(Curve),
    /// Nothing that is read: the kind to name.
    Unknown(String),
}

/// The curve of `record` in its own axes; `following` are the records after it.
fn curve(record: &Record, following: &[Record]) -> Result<Shape, DrawingError> {
    let curve = match record.kind {
        "LINE" => vec![record.point(10)?, record.point(11)?],
        "CIRCLE" => circle_arc(record, 0.0, 2.0 * PI)?,
        "ARC" => {
            let start = record.number(50)?.to_radians();
            let end = record.number(51)?.to_radians();
            circle_arc(record, start, start + counterclockwise(start, end))?
        }
        "ELLIPSE" => ellipse(record)?,
        "LWPOLYLINE" => {
            let closed = record.flags(70)? & 1 == 1;
            bulged_polyline(&record.points(10, 42)?, closed)
        }
        "POLYLINE" => {
            let flags = record.flags(70)?;
            if flags & (16 | 64) != 0 {
                return Ok(Shape::Unknown("POLYLINE mesh".into()));
            }
            bulged_polyline(&vertices(following)?, flags & 1 == 1)
        }
        "SPLINE" => {
            let control = record.points(10, 0)?;
            if control.is_empty() {
                return Ok(Shape::Unknown("SPLINE without control points".into()));
            }
            spline(record, &control)?
        }
        _ => return Ok(Shape::Unknown(name(record))),
    };
    Ok(Shape::Curve(curve))
}

fn circle_arc(record: &Record, start: f64, end: f64) -> Result<Curve, DrawingError> {
    let radius = record.number(40)?;
    if radius <= 0.0 {
        return Err(record.malformed("has a radius that is not positive"));
    }
    let arc = ellipse_arc(record.point(10)?, [radius, 0.0], [0.0, radius], start, end);
    Ok(closed_exactly(arc, end - start))
}

fn ellipse(record: &Record) -> Result<Curve, DrawingError> {
    let major = record.point(11)?;
    let ratio = record.number(40)?;
    let upward = if record.number_or(230, 1.0)? < 0.0 { -ratio } else { ratio };
    let minor = [-major[1] * upward, major[0] * upward];
    let start = record.number_or(41, 0.0)?;
    let sweep = counterclockwise(start, record.number_or(42, 2.0 * PI)?);
    Ok(closed_exactly(ellipse_arc(record.point(10)?, major, minor, start, start + sweep), sweep))
}

/// Ends a whole turn exactly where it begins.
fn closed_exactly(mut curve: Curve, sweep: f64) -> Curve {
    if sweep >= 2.0 * PI - 1e-9 {
        curve.pop();
        curve.extend(curve.first().copied());
    }
    curve
}

/// The vertices (x, y, bulge) up to the record that ends the polyline. Control points of a polyline
/// that was smoothed (flag 16) are left out: the smooth vertices stand beside them.
fn vertices(following: &[Record]) -> Result<Vec<[f64; 3]>, DrawingError> {
    let mut vertices = Vec::new();
    for vertex in following.iter().take_while(|record| record.kind == "VERTEX") {
        if vertex.flags(70)? & 16 == 0 {
            let [x, y] = vertex.point(10)?;
            vertices.push([x, y, vertex.number_or(42, 0.0)?]);
        }
    }
    Ok(vertices)
}

fn spline(record: &Record, control: &[[f64; 3]]) -> Result<Curve, DrawingError> {
    let weights = record.numbers(41)?;
    if !weights.is_empty() && weights.len() != control.len() {
        return Err(record.malformed("has not as many weights as control points"));
    }
    let weights = weights.into_iter().chain(std::iter::repeat(1.0));
    let spline = Spline {
        degree: record.number_or(71, 3.0)? as usize,
        knots: record.numbers(40)?,
        control: control.iter().zip(weights).map(|(&[x, y, _], w)| [x, y, w]).collect(),
    };
    if let Some(problem) = spline.problem() {
        return Err(record.malformed(problem));
    }
    check_limit("curve points", spline.points(), MAX_POINTS)?;
    Ok(spline.flatten())
}

/// How the plane of an entity lies to the drawing plane, by its extrusion direction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Plane {
    /// In it.
    Above,
    /// In it, seen from below.
    Below,
    /// Across it.
    Tilted,
}

impl Plane {
    fn of(record: &Record) -> Result<Self, DrawingError> {
        let normal =
            [record.number_or(210, 0.0)?, record.number_or(220, 0.0)?, record.number_or(230, 1.0)?];
        let aside = normal[0].hypot(normal[1]);
        Ok(if aside > 1e-6 * normal[2].abs() {
            Self::Tilted
        } else if normal[2] < 0.0 {
            Self::Below
        } else {
            Self::Above
        })
    }
}

/// Whether the coordinates of this kind are in the entity's own axes, which turn with its plane.
fn is_in_own_axes(record: &Record) -> bool {
    !matches!(record.kind, "LINE" | "ELLIPSE" | "SPLINE")
}

/// The kind of `record`, short enough for a message.
fn name(record: &Record) -> String {
    record.kind.chars().take(40).collect()
}

fn check_limit(unit: &'static str, found: usize, limit: usize) -> Result<(), DrawingError> {
    if found > limit {
        return Err(DrawingError::TooLarge { unit, found: found as u64, limit: limit as u64 });
    }
    Ok(())
}
