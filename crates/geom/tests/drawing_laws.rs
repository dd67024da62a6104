//! Laws that every drawing keeps on its way to a target.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a helper that fails fails its test")]

use std::{f64::consts::PI, path::PathBuf};

use lasergym_geom::{
    Bitmap, DrawingError, DrawingFormat, DrawingOptions, Fit, Ink, Picture, drawing_from_bytes,
    load_drawing, svg_to_rgba, target_to_png, write_png,
};
use proptest::prelude::*;

const EXACT: DrawingOptions = DrawingOptions {
    margin_px: 5.0,
    threshold: 0.5,
    ink: Ink::Auto,
    invert: false,
    fit: Fit::Exact,
};

fn asset(name: &str) -> PathBuf {
    [env!("CARGO_MANIFEST_DIR"), "../../tests/assets", name].iter().collect()
}

fn svg(content: &str) -> String {
    format!(r#"<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 100 100">{content}</svg>"#)
}

fn read_svg(content: &str, options: &DrawingOptions) -> Result<Bitmap, DrawingError> {
    drawing_from_bytes(svg(content).as_bytes(), DrawingFormat::Svg, options)
}

/// Reads a DXF file written as "code value code value …".
fn read_dxf_file(pairs: &str, options: &DrawingOptions) -> Result<Bitmap, DrawingError> {
    let lines: Vec<&str> = pairs.split_whitespace().collect();
    drawing_from_bytes(lines.join("\r\n").as_bytes(), DrawingFormat::Dxf, options)
}

fn read_dxf(entities: &str, options: &DrawingOptions) -> Result<Bitmap, DrawingError> {
    read_dxf_file(&format!("0 SECTION 2 ENTITIES {entities} 0 ENDSEC 0 EOF"), options)
}

fn read_png(picture: &Picture, options: &DrawingOptions) -> Result<Bitmap, DrawingError> {
    drawing_from_bytes(&picture.to_png().unwrap(), DrawingFormat::Png, options)
}

/// Columns and rows of the bounding box: first and one past the last.
fn bounds(target: &Bitmap) -> [usize; 4] {
    let rows = || target.pixels().map(|pixel| pixel.0);
    let columns = || target.pixels().map(|pixel| pixel.1);
    [
        columns().min().unwrap(),
        columns().max().unwrap() + 1,
        rows().min().unwrap(),
        rows().max().unwrap() + 1,
    ]
}

fn differing_px(a: &Bitmap, b: &Bitmap) -> u32 {
    a.rows().iter().zip(b.rows()).map(|(a, b)| (a ^ b).count_ones()).sum()
}

fn assert_circle_area(target: &Bitmap, radius_px: f64) {
    let area = PI * radius_px * radius_px;
    // The pixels of a circle differ from its area by about the square root of its radius.
    let difference = (f64::from(target.area_px()) - area).abs();
    assert!(difference < 30.0, "{} px instead of {area}", target.area_px());
}

fn bitmaps() -> impl Strategy<Value = Bitmap> {
    prop::collection::vec(any::<u128>(), 100)
        .prop_map(|bits| Bitmap::from_fn(|j, i| bits[j] >> i & 1 == 1))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn a_target_saved_as_png_reads_back_the_same(target in bitmaps()) {
        let png = target_to_png(&target).unwrap();
        let read = drawing_from_bytes(&png, DrawingFormat::Png, &EXACT).unwrap();
        prop_assert_eq!(read, target);
    }

    #[test]
    fn an_inverted_image_is_the_complement(target in bitmaps()) {
        let png = target_to_png(&target).unwrap();
        let inverted = DrawingOptions { invert: true, ..EXACT };
        let read = drawing_from_bytes(&png, DrawingFormat::Png, &inverted).unwrap();
        prop_assert_eq!(read, target.complement());
    }

    #[test]
    fn a_rectangle_keeps_its_aspect_and_the_margin(
        width in 20.0..90.0, height in 20.0..90.0, x in 0.0..10.0, y in 0.0..10.0,
        margin_px in 0.0..30.0
    ) {
        let options = DrawingOptions { margin_px, ..DrawingOptions::default() };
        let rectangle = format!(r#"<rect x="{x}" y="{y}" width="{width}" height="{height}"/>"#);
        let lines = format!(
            "0 LWPOLYLINE 70 1 10 {x} 20 {y} 10 {r} 20 {y} 10 {r} 20 {b} 10 {x} 20 {b}",
            r = x + width, b = y + height
        );
        let scale = (100.0 - 2.0 * margin_px) / f64::max(width, height);
        for target in [read_svg(&rectangle, &options), read_dxf(&lines, &options)] {
            let target = target.unwrap();
            let [left, right, top, bottom] = bounds(&target).map(|edge| edge as f64);
            prop_assert!((right - left - scale * width).abs() <= 1.1, "{left} {right}");
            prop_assert!((bottom - top - scale * height).abs() <= 1.1, "{top} {bottom}");
            // A pixel that the edge of the margin cuts may be target.
            for free in [left, top, 100.0 - right, 100.0 - bottom] {
                prop_assert!(free >= margin_px - 0.6, "{free} {margin_px}");
            }
            prop_assert!((left - (100.0 - right)).abs() <= 1.0);
            prop_assert!((top - (100.0 - bottom)).abs() <= 1.0);
        }
    }

    #[test]
    fn an_image_of_any_size_fits_the_workpiece(width in 1_u32..300, height in 1_u32..300) {
        let rgba = [0, 0, 0, 255].repeat((width * height) as usize);
        let picture = Picture { width_px: width, height_px: height, rgba };
        match read_png(&picture, &DrawingOptions::default()) {
            Ok(target) => {
                let [left, right, top, bottom] = bounds(&target);
                prop_assert!(left >= 5 && right <= 95 && top >= 5 && bottom <= 95);
                prop_assert!(right - left == 90 || bottom - top == 90);
            }
            // A strip less than a workpiece pixel wide covers no pixel by half.
            Err(DrawingError::EmptyTarget) => {
                prop_assert!(90 * width.min(height) <= width.max(height));
            }
            Err(error) => prop_assert!(false, "{error}"),
        }
    }
}

#[test]
fn assets_are_targets_of_machinable_size() {
    for (name, area_px) in [
        ("thumbs_up.svg", 4837),
        ("thumbs_up.png", 4826),
        ("ellipse.svg", 4248),
        ("logo.svg", 5074),
        ("bracket.dxf", 4699),
    ] {
        let target = load_drawing(asset(name), &DrawingOptions::default()).unwrap();
        assert!(target.area_px().abs_diff(area_px) < 20, "{name}: {} px", target.area_px());
        let [left, right, top, bottom] = bounds(&target);
        assert!(left >= 5 && right <= 95 && top >= 5 && bottom <= 95, "{name}");
        assert!(right - left >= 89 || bottom - top >= 89, "{name}");
    }
}

#[test]
fn a_png_and_its_svg_are_the_same_target() {
    let options = DrawingOptions::default();
    let from_svg = load_drawing(asset("thumbs_up.svg"), &options).unwrap();
    let from_png = load_drawing(asset("thumbs_up.png"), &options).unwrap();
    assert!(differing_px(&from_svg, &from_png) < 60);
}

#[test]
fn holes_are_left_out() {
    let logo = load_drawing(asset("logo.svg"), &DrawingOptions::default()).unwrap();
    assert!(!logo.contains(50, 38) && logo.contains(50, 20));
    let bracket = load_drawing(asset("bracket.dxf"), &DrawingOptions::default()).unwrap();
    // The larger hole is at the lower left: y points up in DXF.
    assert!(!bracket.contains(77, 23) && bracket.contains(50, 12) && !bracket.contains(20, 80));
}

#[test]
fn a_target_is_written_to_disk_and_read_back() {
    let target = load_drawing(asset("bracket.dxf"), &DrawingOptions::default()).unwrap();
    let folder = std::env::temp_dir().join(format!("lasergym-target-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join("target.png");
    write_png(&target, &path).unwrap();
    let read = load_drawing(&path, &EXACT).unwrap();
    std::fs::remove_dir_all(&folder).unwrap();
    assert_eq!(read, target);
}

#[test]
fn content_goes_before_the_extension() {
    let folder = std::env::temp_dir().join(format!("lasergym-content-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join("circle.png");
    std::fs::write(&path, svg(r#"<circle cx="50" cy="50" r="40"/>"#)).unwrap();
    let target = load_drawing(&path, &DrawingOptions::default());
    std::fs::remove_dir_all(&folder).unwrap();
    assert_circle_area(&target.unwrap(), 45.0);
}

#[test]
fn a_circle_has_its_area_in_every_vector_format() {
    let options = DrawingOptions::default();
    let from_svg = read_svg(r#"<circle cx="41" cy="47" r="31"/>"#, &options).unwrap();
    assert_circle_area(&from_svg, 45.0);
    let from_dxf = read_dxf("0 CIRCLE 10 700 20 -300 40 31", &options).unwrap();
    assert_circle_area(&from_dxf, 45.0);
    assert!(differing_px(&from_svg, &from_dxf) < 40, "{}", differing_px(&from_svg, &from_dxf));
}

#[test]
fn an_exact_fit_keeps_user_units() {
    let from_svg = read_svg(r#"<circle cx="30" cy="60" r="20"/>"#, &EXACT).unwrap();
    assert_circle_area(&from_svg, 20.0);
    assert_eq!(bounds(&from_svg), [10, 50, 40, 80]);
    let from_dxf = read_dxf("0 CIRCLE 10 30 20 40 40 20", &EXACT).unwrap();
    assert!(differing_px(&from_svg, &from_dxf) < 20);
}

#[test]
fn an_svg_page_in_millimetres_keeps_user_units() {
    let page = r#"<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 100 100" width="7mm"
        height="7mm"><rect x="10" y="20" width="30" height="40"/></svg>"#;
    let target = drawing_from_bytes(page.as_bytes(), DrawingFormat::Svg, &EXACT).unwrap();
    assert_eq!(target, Bitmap::from_fn(|j, i| (20..60).contains(&j) && (10..40).contains(&i)));
}

#[test]
fn a_small_drawing_on_a_large_page_is_sharp() {
    let page = r#"<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 90000 90000">
        <circle cx="70000" cy="20000" r="300"/></svg>"#;
    let target =
        drawing_from_bytes(page.as_bytes(), DrawingFormat::Svg, &DrawingOptions::default());
    assert_circle_area(&target.unwrap(), 45.0);
}

#[test]
fn what_leaves_the_page_is_not_drawn() {
    let content = r#"<circle cx="50" cy="50" r="40"/><rect x="120" y="0" width="50" height="9"/>"#;
    assert_circle_area(&read_svg(content, &DrawingOptions::default()).unwrap(), 45.0);
}

#[test]
fn transforms_references_clips_masks_and_strokes_are_resolved() {
    let disc = read_svg(r#"<circle cx="50" cy="50" r="30"/>"#, &EXACT).unwrap();
    for content in [
        r#"<g transform="translate(20 20) scale(3)"><circle cx="10" cy="10" r="10"/></g>"#,
        r##"<defs><circle id="c" r="30"/></defs><use href="#c" x="50" y="50"/>"##,
        r#"<clipPath id="k"><circle cx="50" cy="50" r="30"/></clipPath>
            <rect width="100" height="100" clip-path="url(#k)"/>"#,
        r#"<mask id="m" maskUnits="userSpaceOnUse" x="0" y="0" width="100" height="100">
            <circle cx="50" cy="50" r="30" fill="white"/></mask>
            <rect width="100" height="100" mask="url(#m)"/>"#,
        r#"<circle cx="50" cy="50" r="15" fill="none" stroke="black" stroke-width="30"/>"#,
    ] {
        let target = read_svg(content, &EXACT).unwrap();
        assert!(differing_px(&target, &disc) < 12, "{content}");
    }
}

#[test]
fn pale_shapes_on_a_transparent_page_are_ink_and_white_ones_are_holes() {
    let disc = read_svg(r#"<circle cx="50" cy="50" r="30"/>"#, &EXACT).unwrap();
    let hole = read_svg(r#"<circle cx="50" cy="50" r="10"/>"#, &EXACT).unwrap();
    let pale = r##"<circle cx="50" cy="50" r="30" fill="#ffd"/>
        <circle cx="50" cy="50" r="10" fill="white"/>"##;
    let target = read_svg(pale, &EXACT).unwrap();
    assert!(differing_px(&target, &disc).abs_diff(hole.area_px()) < 12);
    let alpha = DrawingOptions { ink: Ink::Alpha, ..EXACT };
    assert!(differing_px(&read_svg(pale, &alpha).unwrap(), &disc) < 12);
    let luminance = DrawingOptions { ink: Ink::Luminance, ..EXACT };
    assert!(matches!(read_svg(pale, &luminance), Err(DrawingError::EmptyTarget)));
}

#[test]
fn dark_is_ink_on_an_opaque_page() {
    let content = r#"<rect width="100" height="100" fill="white"/>
        <circle cx="50" cy="50" r="30" fill="navy"/><circle cx="15" cy="15" r="9" fill="yellow"/>"#;
    let target = read_svg(content, &EXACT).unwrap();
    assert!(target.contains(50, 50) && !target.contains(15, 15) && !target.contains(90, 90));
}

#[test]
fn a_threshold_chooses_the_shades_that_are_ink() {
    let page = svg(r##"<rect width="100" height="100" fill="white"/>
        <rect x="20" y="20" width="30" height="30" fill="#444"/>
        <rect x="50" y="20" width="30" height="30" fill="#aaa"/>"##);
    let picture = svg_to_rgba(&page, 100).unwrap();
    for (threshold, area_px) in [(0.2, 1800), (0.5, 900)] {
        let options = DrawingOptions { threshold, ..EXACT };
        assert_eq!(read_png(&picture, &options).unwrap().area_px(), area_px);
    }
}

#[test]
fn a_jpeg_is_the_same_target_as_its_png() {
    let page =
        svg(r#"<rect width="100" height="100" fill="white"/><circle cx="50" cy="50" r="40"/>"#);
    let picture = svg_to_rgba(&page, 200).unwrap();
    let rgb: Vec<u8> = picture.rgba.chunks(4).flat_map(|pixel| &pixel[..3]).copied().collect();
    let mut jpeg = Vec::new();
    image::codecs::jpeg::JpegEncoder::new_with_quality(&mut jpeg, 95)
        .encode(&rgb, 200, 200, image::ExtendedColorType::Rgb8)
        .unwrap();
    let options = DrawingOptions::default();
    let from_jpeg = drawing_from_bytes(&jpeg, DrawingFormat::Jpeg, &options).unwrap();
    assert!(differing_px(&from_jpeg, &read_png(&picture, &options).unwrap()) < 30);
}

#[test]
fn an_inverted_vector_drawing_is_its_frame_without_it() {
    let inverted = DrawingOptions { invert: true, ..EXACT };
    let circle = r#"<circle cx="30" cy="60" r="20"/>"#;
    let plain = read_svg(circle, &EXACT).unwrap();
    assert!(differing_px(&read_svg(circle, &inverted).unwrap(), &plain.complement()) < 12);
    let entity = "0 CIRCLE 10 30 20 40 40 20";
    let plain = read_dxf(entity, &EXACT).unwrap();
    assert_eq!(read_dxf(entity, &inverted).unwrap(), plain.complement());
    let fitted = DrawingOptions { invert: true, ..DrawingOptions::default() };
    let corners = 8100.0 - PI * 45.0 * 45.0;
    let area = f64::from(read_dxf(entity, &fitted).unwrap().area_px());
    assert!((area - corners).abs() < 30.0, "{area}");
}

#[test]
fn a_half_disc_is_the_same_by_bulge_arc_ellipse_and_spline() {
    let line = "0 LINE 10 20 20 50 11 80 21 50";
    let half = read_dxf(&format!("0 ARC 10 50 20 50 40 30 50 0 51 180 {line}"), &EXACT).unwrap();
    assert!((f64::from(half.area_px()) - PI * 450.0).abs() < 30.0);
    assert!(half.contains(40, 50) && !half.contains(60, 50));
    let weight = 0.5_f64.sqrt();
    for entities in [
        "0 LWPOLYLINE 70 1 10 80 20 50 42 1 10 20 20 50".to_owned(),
        "0 LWPOLYLINE 70 1 10 20 20 50 42 -1 10 80 20 50".to_owned(),
        "0 POLYLINE 70 1 0 VERTEX 10 80 20 50 42 1 0 VERTEX 10 20 20 50 0 SEQEND".to_owned(),
        format!("0 ELLIPSE 10 50 20 50 11 30 21 0 40 1 41 0 42 {PI} {line}"),
        // Seen from below, x points left.
        format!("0 ARC 10 -50 20 50 40 30 50 0 51 180 230 -1 {line}"),
        format!(
            "{line} 0 SPLINE 71 2 40 0 40 0 40 0 40 1 40 1 40 2 40 2 40 2 \
             41 1 41 {weight} 41 1 41 {weight} 41 1 \
             10 80 20 50 10 80 20 80 10 50 20 80 10 20 20 80 10 20 20 50"
        ),
    ] {
        let target = read_dxf(&entities, &EXACT).unwrap();
        assert!(differing_px(&target, &half) < 6, "{entities}");
    }
}

#[test]
fn an_inserted_block_is_moved_turned_and_scaled() {
    let block = "0 SECTION 2 BLOCKS 0 BLOCK 2 half 10 1 20 0 \
                 0 LWPOLYLINE 10 1 20 0 10 3 20 0 10 3 20 1 10 1 20 1 70 1 0 ENDBLK 0 ENDSEC";
    let insert =
        "0 SECTION 2 ENTITIES 0 INSERT 2 half 10 60 20 30 41 10 42 20 50 90 0 ENDSEC 0 EOF";
    let target = read_dxf_file(&format!("{block} {insert}"), &EXACT).unwrap();
    // 20 wide and 20 high, turned left about its lower left corner at (60, 30).
    let square = Bitmap::from_fn(|j, i| (50..70).contains(&j) && (40..60).contains(&i));
    assert!(differing_px(&target, &square) <= 20, "{target:?}");
}

#[test]
fn lines_in_any_order_and_direction_join_to_a_contour() {
    let square = "0 LINE 10 10 20 10 11 60 21 10 0 LINE 10 10 20 60 11 10 21 10 \
                  0 LINE 10 60 20 60 11 10 21 60.004 0 LINE 10 60 20 10 11 60 21 60";
    assert_eq!(read_dxf(square, &EXACT).unwrap().area_px(), 2500);
    // Drawn twice, it is still the same.
    assert_eq!(read_dxf(&format!("{square} {square}"), &EXACT).unwrap().area_px(), 2500);
}

#[test]
fn notes_and_hidden_entities_of_a_dxf_are_passed_over() {
    let file = "0 SECTION 2 TABLES 0 LAYER 2 off 62 -7 70 0 0 ENDSEC \
                0 SECTION 2 ENTITIES 0 CIRCLE 10 50 20 50 40 30 0 POINT 10 0 20 0 \
                0 DIMENSION 1 60 0 TEXT 8 off 1 note 0 LINE 60 1 10 0 20 0 11 9 21 9 \
                0 LINE 67 1 10 0 20 0 11 9 21 9 0 ENDSEC 0 EOF";
    assert_circle_area(&read_dxf_file(file, &EXACT).unwrap(), 30.0);
}

#[test]
fn a_document_type_of_plain_entities_is_resolved() {
    let page = r#"<?xml version="1.0"?>
        <!DOCTYPE svg PUBLIC "-//W3C//DTD SVG 1.1//EN" "svg11.dtd" [
            <!ENTITY space "http://www.w3.org/2000/svg">
            <!ENTITY blue '#00f'>
        ]>
        <svg xmlns="&space;" viewBox="0 0 100 100">
            <circle cx="50" cy="50" r="30" fill="&blue;"/></svg>"#;
    let target = drawing_from_bytes(page.as_bytes(), DrawingFormat::Svg, &EXACT).unwrap();
    assert_circle_area(&target, 30.0);
}
