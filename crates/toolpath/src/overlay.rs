//! The picture of a machined pattern: target, pulses in order and extent of machining.

use std::fmt::Write;

use lasergym_geom::{Bitmap, PIXEL_UM, Point, WORKPIECE_SIZE_PX};

use crate::bitmap_outline::outlines;
use crate::color_ramp::order_color;
use crate::disc_union::{Arc, outline};
use crate::pulse_path::{check_position, check_pulse_radius};
use crate::{PulsePath, ToolpathError};

/// Most pulses that are drawn; the outline of their union costs their number squared.
const MAX_DRAWN_PULSES: usize = 10_000;

const PAGE: &str = "#ffffff";
const BACKGROUND: &str = "#eceef0";
const TARGET: &str = "#ffd94a";
const MACHINED: &str = "#128a3a";
const PULSE: &str = "#e01b24";
const INK: &str = "#24292f";

/// Blank border of the page, px of the workpiece.
const MARGIN: f64 = 3.0;
/// Height of the caption and of the row below the workpiece, and text size, px.
const ROW: f64 = 8.0;
const TEXT: f64 = 3.6;

/// One pulse as it was fired.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pulse {
    /// Where it landed, px.
    pub position_px: Point,
    /// Radius of its mark, px.
    pub radius_px: f64,
}

/// A target and the pulses fired at it, in order.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory {
    target: Bitmap,
    pulses: Vec<Pulse>,
}

impl Trajectory {
    /// `pulses`, in firing order and each with a radius of its own, over `target`.
    ///
    /// # Errors
    /// [`ToolpathError::TooManyPulses`] above 10 000, [`ToolpathError::Position`] and
    /// [`ToolpathError::PulseRadius`] as for [`PulsePath::new`].
    pub fn new(target: Bitmap, pulses: Vec<Pulse>) -> Result<Self, ToolpathError> {
        if pulses.len() > MAX_DRAWN_PULSES {
            return Err(ToolpathError::TooManyPulses { limit: MAX_DRAWN_PULSES });
        }
        for (k, pulse) in pulses.iter().enumerate() {
            check_position(k + 1, pulse.position_px)?;
            check_pulse_radius(pulse.radius_px)?;
        }
        Ok(Self { target, pulses })
    }

    /// The pulses of `path`, landed where they were aimed, over `target`.
    ///
    /// # Errors
    /// [`ToolpathError::TooManyPulses`] above 10 000.
    pub fn of_path(target: Bitmap, path: &PulsePath) -> Result<Self, ToolpathError> {
        let radius_px = path.pulse_radius_px();
        let pulse = |&position_px: &Point| Pulse { position_px, radius_px };
        Self::new(target, path.positions_px().iter().map(pulse).collect())
    }
}

/// How a trajectory is drawn.
#[derive(Debug, Clone, PartialEq)]
pub struct OverlayOptions {
    /// Width of the picture, px of the screen; the height follows. Default 800.
    pub width_px: u32,
    /// Whether every pulse carries its number; beyond some 50 pulses the numbers overlap. Default
    /// false.
    pub order_numbers: bool,
    /// Whether the colour bar of the order, the key of the colours and a scale bar of 20 µm are drawn
    /// beside and below the workpiece. Default true.
    pub legend: bool,
    /// Whether anything is written: order numbers, legend, scale and caption. Off for a renderer
    /// without fonts. Default true.
    pub labels: bool,
    /// A line above the workpiece, such as the score; control characters are left out. Default none.
    pub caption: Option<String>,
}

impl Default for OverlayOptions {
    fn default() -> Self {
        Self { width_px: 800, order_numbers: false, legend: true, labels: true, caption: None }
    }
}

/// The trajectory as an SVG picture in the style of Xie et al. 2022, Fig. 2 (c): the target yellow,
/// pulse centres as red dots joined by a line coloured by order (dark first), the outline of
/// everything machined green.
///
/// One user unit is one workpiece pixel. What lies outside the workpiece is cut off.
#[must_use]
pub fn trajectory_svg(trajectory: &Trajectory, options: &OverlayOptions) -> String {
    let size = WORKPIECE_SIZE_PX as f64;
    let caption = options.caption.as_deref().filter(|_| options.labels);
    let top = if caption.is_some() { ROW } else { MARGIN };
    let side = match (options.legend, options.labels) {
        (false, _) => MARGIN,
        (true, false) => MARGIN + 5.5,
        (true, true) => MARGIN + 13.5,
    };
    let row = if options.legend { ROW } else { MARGIN };
    let (width, height) = (MARGIN + size + side, top + size + row);
    let height_px = (f64::from(options.width_px) * height / width).round();
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{}\" height=\"{height_px}\" \
         viewBox=\"0 0 {width} {height}\" font-family=\"DejaVu Sans, Helvetica, Arial, sans-serif\" \
         font-size=\"{TEXT}\" fill=\"{INK}\">\n\
         <rect width=\"{width}\" height=\"{height}\" fill=\"{PAGE}\"/>\n",
        options.width_px,
    );
    if let Some(caption) = caption {
        let baseline = 0.5 * (top + TEXT) - 0.3;
        line(
            &mut svg,
            &format!("<text x=\"{MARGIN}\" y=\"{baseline}\">{}</text>", escaped(caption)),
        );
    }
    line(&mut svg, &format!("<g transform=\"translate({MARGIN} {top})\">"));
    draw_workpiece(&mut svg, trajectory, options);
    if options.legend {
        draw_scale_bar(&mut svg, options.labels);
        draw_order_bar(&mut svg, trajectory.pulses.len(), options.labels);
        if options.labels {
            draw_key(&mut svg);
        }
    }
    svg.push_str("</g>\n</svg>\n");
    svg
}

fn draw_workpiece(svg: &mut String, trajectory: &Trajectory, options: &OverlayOptions) {
    let size = WORKPIECE_SIZE_PX;
    line(
        svg,
        &format!(
            "<clipPath id=\"workpiece\"><rect width=\"{size}\" height=\"{size}\"/></clipPath>\n\
             <g clip-path=\"url(#workpiece)\">\n\
             <rect width=\"{size}\" height=\"{size}\" fill=\"{BACKGROUND}\"/>"
        ),
    );
    line(svg, &format!("<path fill=\"{TARGET}\" d=\"{}\"/>", target_path(&trajectory.target)));
    line(
        svg,
        &format!(
            "<path fill=\"none\" stroke=\"{MACHINED}\" stroke-width=\"0.9\" \
             stroke-linecap=\"round\" d=\"{}\"/>",
            arcs_path(&outline(&trajectory.pulses))
        ),
    );
    draw_moves(svg, &trajectory.pulses);
    draw_centres(svg, &trajectory.pulses);
    if options.order_numbers && options.labels {
        draw_numbers(svg, &trajectory.pulses);
    }
    line(
        svg,
        &format!(
            "</g>\n<rect width=\"{size}\" height=\"{size}\" fill=\"none\" stroke=\"{INK}\" \
             stroke-width=\"0.3\"/>"
        ),
    );
}

/// The moves, each in the colour of its order, over a white line that sets them off.
fn draw_moves(svg: &mut String, pulses: &[Pulse]) {
    if pulses.len() < 2 {
        return;
    }
    let corners: Vec<String> = pulses.iter().map(|pulse| pair(pulse.position_px)).collect();
    line(
        svg,
        &format!(
            "<polyline fill=\"none\" stroke=\"{PAGE}\" stroke-width=\"1.7\" stroke-opacity=\"0.75\" \
             stroke-linejoin=\"round\" points=\"{}\"/>",
            corners.join(" ")
        ),
    );
    svg.push_str("<g stroke-width=\"0.9\" stroke-linecap=\"round\">\n");
    let last_move = (pulses.len() - 2).max(1) as f64;
    for (k, ends) in pulses.windows(2).enumerate() {
        let (start, end) = (ends[0].position_px, ends[1].position_px);
        line(
            svg,
            &format!(
                "<line x1=\"{}\" y1=\"{}\" x2=\"{}\" y2=\"{}\" stroke=\"{}\"/>",
                short(start.x),
                short(start.y),
                short(end.x),
                short(end.y),
                order_color(k as f64 / last_move)
            ),
        );
    }
    svg.push_str("</g>\n");
}

fn draw_centres(svg: &mut String, pulses: &[Pulse]) {
    line(svg, &format!("<g fill=\"{PULSE}\" stroke=\"{PAGE}\" stroke-width=\"0.3\">"));
    for pulse in pulses {
        let (x, y) = (short(pulse.position_px.x), short(pulse.position_px.y));
        line(svg, &format!("<circle cx=\"{x}\" cy=\"{y}\" r=\"1.15\"/>"));
    }
    svg.push_str("</g>\n");
}

fn draw_numbers(svg: &mut String, pulses: &[Pulse]) {
    line(
        svg,
        &format!(
            "<g font-size=\"2.5\" paint-order=\"stroke\" stroke=\"{PAGE}\" stroke-width=\"0.6\" \
             stroke-linejoin=\"round\">"
        ),
    );
    for (k, pulse) in pulses.iter().enumerate() {
        let (x, y) = (short(pulse.position_px.x + 1.3), short(pulse.position_px.y - 1.1));
        line(svg, &format!("<text x=\"{x}\" y=\"{y}\">{}</text>", k + 1));
    }
    svg.push_str("</g>\n");
}

/// A bar of 20 µm below the left edge.
fn draw_scale_bar(svg: &mut String, labels: bool) {
    let length = 20.0 / PIXEL_UM;
    let (y, baseline) = (WORKPIECE_SIZE_PX as f64 + 4.0, WORKPIECE_SIZE_PX as f64 + 5.3);
    line(svg, &format!("<rect y=\"{}\" width=\"{length}\" height=\"0.9\"/>", y - 0.45));
    if labels {
        line(svg, &format!("<text x=\"{}\" y=\"{baseline}\">20 µm</text>", length + 1.5));
    }
}

/// The colours of the order right of the workpiece, the first pulse at the top.
fn draw_order_bar(svg: &mut String, pulses: usize, labels: bool) {
    const STOPS: usize = 16;
    let (left, size) = (WORKPIECE_SIZE_PX as f64 + 2.5, WORKPIECE_SIZE_PX as f64);
    line(svg, "<linearGradient id=\"order\" x2=\"0\" y2=\"1\">");
    for k in 0..=STOPS {
        let t = k as f64 / STOPS as f64;
        line(svg, &format!("<stop offset=\"{t}\" stop-color=\"{}\"/>", order_color(t)));
    }
    line(
        svg,
        &format!(
            "</linearGradient>\n<rect x=\"{left}\" width=\"3\" height=\"{size}\" \
             fill=\"url(#order)\"/>"
        ),
    );
    if !labels {
        return;
    }
    let (x, middle) = (left + 4.2, 0.5 * size);
    line(svg, &format!("<text x=\"{x}\" y=\"2.8\">1</text>"));
    line(svg, &format!("<text x=\"{x}\" y=\"{}\">{}</text>", size - 0.1, pulses.max(1)));
    line(
        svg,
        &format!(
            "<text text-anchor=\"middle\" transform=\"translate({} {middle}) rotate(-90)\">\
             pulse number</text>",
            x + 2.8
        ),
    );
}

/// What yellow, green and red mean, below the right half of the workpiece.
fn draw_key(svg: &mut String) {
    let (y, baseline) = (WORKPIECE_SIZE_PX as f64 + 4.0, WORKPIECE_SIZE_PX as f64 + 5.3);
    let top = y - 1.5;
    line(svg, &format!("<rect x=\"39\" y=\"{top}\" width=\"4\" height=\"3\" fill=\"{TARGET}\"/>"));
    line(svg, &format!("<text x=\"44.5\" y=\"{baseline}\">target</text>"));
    let stroke = format!("stroke=\"{MACHINED}\" stroke-width=\"0.9\"");
    line(svg, &format!("<path d=\"M60 {y}h4.5\" {stroke}/>"));
    line(svg, &format!("<text x=\"66\" y=\"{baseline}\">machined</text>"));
    line(svg, &format!("<circle cx=\"88.3\" cy=\"{y}\" r=\"1.15\" fill=\"{PULSE}\"/>"));
    line(svg, &format!("<text x=\"90.6\" y=\"{baseline}\">pulse</text>"));
}

/// The border of a bitmap as path data: corners joined by horizontal and vertical lines.
fn target_path(target: &Bitmap) -> String {
    let mut path = String::new();
    for outline in outlines(target) {
        let mut corners = outline.iter();
        let Some(mut from) = corners.next() else { continue };
        // Writing to a String cannot fail.
        let _ = write!(path, "M{} {}", from.x, from.y);
        for corner in corners {
            let _ = if (from.y - corner.y).abs() < 0.5 {
                write!(path, "H{}", corner.x)
            } else {
                write!(path, "V{}", corner.y)
            };
            from = corner;
        }
        path.push('Z');
    }
    path
}

/// Arcs as path data, a whole circle as two halves.
fn arcs_path(arcs: &[Arc]) -> String {
    let mut path = String::new();
    for arc in arcs {
        let radius = short(arc.radius_px);
        // Writing to a String cannot fail.
        let _ = write!(path, "M{}", pair(arc.point(0.0)));
        for half in [0.5, 1.0] {
            let end = pair(arc.point(half * arc.sweep_rad));
            let _ = write!(path, "A{radius} {radius} 0 0 1 {end}");
        }
    }
    path
}

fn line(svg: &mut String, element: &str) {
    svg.push_str(element);
    svg.push('\n');
}

fn pair(point: Point) -> String {
    format!("{} {}", short(point.x), short(point.y))
}

/// A coordinate to a thousandth of a pixel, without trailing zeros.
fn short(value: f64) -> String {
    let thousandths = (value * 1e3).round() + 0.0;
    (thousandths / 1e3).to_string()
}

/// Text that may stand in an XML element.
fn escaped(text: &str) -> String {
    let mut escaped = String::new();
    for character in text.chars() {
        match character {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            // Not characters of XML 1.0.
            '\u{fffe}' | '\u{ffff}' => {}
            _ if character.is_control() => {}
            _ => escaped.push(character),
        }
    }
    escaped
}

#[cfg(test)]
mod tests {
    use super::*;
    use lasergym_geom::svg_to_rgba;
    use proptest::prelude::*;

    /// Target: the left half; pulses at `positions_px` of radius 9 px.
    fn half_target(positions_px: &[Point]) -> Trajectory {
        let target = Bitmap::from_fn(|_, i| i < 50);
        let path = PulsePath::new(positions_px.to_vec(), 9.0).unwrap();
        Trajectory::of_path(target, &path).unwrap()
    }

    fn plain() -> OverlayOptions {
        OverlayOptions { legend: false, labels: false, ..OverlayOptions::default() }
    }

    /// Colour at a workpiece position of a plain picture rendered at 10 screen pixels per pixel.
    fn color_at(svg: &str, x_px: f64, y_px: f64) -> [u8; 3] {
        let picture = svg_to_rgba(svg, 1060).unwrap();
        let column = ((x_px + MARGIN) * 10.0) as usize;
        let row = ((y_px + MARGIN) * 10.0) as usize;
        let k = 4 * (row * picture.width_px as usize + column);
        [picture.rgba[k], picture.rgba[k + 1], picture.rgba[k + 2]]
    }

    fn rgb(color: &str) -> [u8; 3] {
        [1, 3, 5].map(|k| u8::from_str_radix(&color[k..k + 2], 16).unwrap())
    }

    #[test]
    fn every_part_has_its_color_where_it_lies() {
        let trajectory = half_target(&[Point::new(30.0, 40.0), Point::new(40.0, 40.0)]);
        let svg = trajectory_svg(&trajectory, &plain());
        let expected = [
            (10.05, 90.05, TARGET),
            (90.05, 90.05, BACKGROUND),
            (30.05, 40.05, PULSE),
            (40.05, 40.05, PULSE),
            (21.05, 40.05, MACHINED),
            (48.95, 40.05, MACHINED),
            // Where the first disc's circle runs inside the second, nothing is drawn.
            (38.05, 44.15, TARGET),
            (35.05, 40.05, order_color(0.0).as_str()),
        ]
        .map(|(x, y, color)| (x, y, rgb(color)));
        for (x, y, color) in expected {
            assert_eq!(color_at(&svg, x, y), color, "at ({x}, {y})");
        }
    }

    #[test]
    fn the_picture_stops_at_the_edge_of_the_workpiece() {
        let trajectory = half_target(&[Point::new(100.0, 50.0)]);
        let svg = trajectory_svg(&trajectory, &plain());
        assert_eq!(color_at(&svg, 102.0, 50.05), rgb(PAGE));
        assert_eq!(color_at(&svg, 91.05, 50.05), rgb(MACHINED));
    }

    #[test]
    fn few_pulses_are_drawn_too() {
        for pulses in 0..3 {
            let positions = vec![Point::new(50.0, 50.0); pulses];
            let svg = trajectory_svg(&half_target(&positions), &plain());
            assert_eq!(svg.matches("<circle").count(), pulses);
            assert!(svg_to_rgba(&svg, 100).is_ok());
        }
    }

    #[test]
    fn nothing_is_written_without_labels() {
        let trajectory = half_target(&[Point::new(30.0, 40.0); 3]);
        let caption = Some("a <caption> & more\u{1}".to_owned());
        let all = OverlayOptions { order_numbers: true, caption, ..OverlayOptions::default() };
        let svg = trajectory_svg(&trajectory, &all);
        assert!(svg.contains(">a &lt;caption&gt; &amp; more</text>"));
        assert!(svg.contains(">3</text>"));
        let svg = trajectory_svg(&trajectory, &OverlayOptions { labels: false, ..all });
        assert!(!svg.contains("<text"));
    }

    #[test]
    fn pulses_out_of_range_are_refused() {
        let pulse = Pulse { position_px: Point::new(1.0, 1.0), radius_px: 9.0 };
        let drawn = |pulses| Trajectory::new(Bitmap::EMPTY, pulses).unwrap_err();
        let astray = Pulse { position_px: Point::new(f64::NAN, 1.0), ..pulse };
        assert!(matches!(drawn(vec![astray]), ToolpathError::Position { pulse: 1, .. }));
        let flat = Pulse { radius_px: 0.0, ..pulse };
        assert_eq!(drawn(vec![flat]), ToolpathError::PulseRadius { radius_px: 0.0 });
        let limit = MAX_DRAWN_PULSES;
        assert_eq!(drawn(vec![pulse; limit + 1]), ToolpathError::TooManyPulses { limit });
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]

        #[test]
        fn every_trajectory_gives_a_picture(
            pulses in proptest::collection::vec((-20.0..120.0, -20.0..120.0, 0.1..40.0_f64), 0..30),
            caption in proptest::option::of("\\PC{0,30}")
        ) {
            let pulses = pulses.into_iter().map(|(x, y, radius_px)| Pulse {
                position_px: Point::new(x, y),
                radius_px,
            });
            let trajectory = Trajectory::new(Bitmap::full(), pulses.collect()).unwrap();
            let options = OverlayOptions { caption, labels: false, ..OverlayOptions::default() };
            prop_assert!(svg_to_rgba(&trajectory_svg(&trajectory, &options), 64).is_ok());
        }
    }
}
