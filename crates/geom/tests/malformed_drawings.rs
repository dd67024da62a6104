//! Each malformed drawing is refused by its own error.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a helper that fails fails its test")]

use std::path::{Path, PathBuf};

use lasergym_geom::{
    Bitmap, DrawingError, DrawingFormat, DrawingOptions, Fit, Picture, drawing_from_bytes,
    load_drawing, target_to_png, write_png,
};

macro_rules! assert_refused {
    ($result:expr, $error:pat $(if $guard:expr)?) => {
        match $result.expect_err("it is refused") {
            $error $(if $guard)? => {}
            other => panic!("{other:?}"),
        }
    };
}

fn asset(name: &str) -> PathBuf {
    [env!("CARGO_MANIFEST_DIR"), "../../tests/assets", name].iter().collect()
}

fn read(bytes: impl AsRef<[u8]>, format: DrawingFormat) -> Result<Bitmap, DrawingError> {
    drawing_from_bytes(bytes.as_ref(), format, &DrawingOptions::default())
}

fn read_exactly(bytes: impl AsRef<[u8]>, format: DrawingFormat) -> Result<Bitmap, DrawingError> {
    let options = DrawingOptions { fit: Fit::Exact, ..DrawingOptions::default() };
    drawing_from_bytes(bytes.as_ref(), format, &options)
}

fn read_svg(content: &str) -> Result<Bitmap, DrawingError> {
    let page = format!(
        r#"<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"
            viewBox="0 0 100 100">{content}</svg>"#
    );
    read(page, DrawingFormat::Svg)
}

/// Reads a DXF file written as "code value code value …".
fn read_dxf_file(pairs: &str) -> Result<Bitmap, DrawingError> {
    let lines: Vec<&str> = pairs.split_whitespace().collect();
    read(lines.join("\n"), DrawingFormat::Dxf)
}

fn read_dxf(entities: &str) -> Result<Bitmap, DrawingError> {
    read_dxf_file(&format!("0 SECTION 2 ENTITIES {entities} 0 ENDSEC 0 EOF"))
}

/// A file in a folder of its own, read and removed.
fn load_file(name: &str, bytes: &[u8]) -> Result<Bitmap, DrawingError> {
    let folder = std::env::temp_dir().join(format!("lasergym-{name}-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join(name);
    std::fs::write(&path, bytes).unwrap();
    let result = load_drawing(&path, &DrawingOptions::default());
    std::fs::remove_dir_all(&folder).unwrap();
    result
}

fn plain_png(pixel: [u8; 4]) -> Vec<u8> {
    Picture { width_px: 40, height_px: 40, rgba: pixel.repeat(1600) }.to_png().unwrap()
}

/// A PNG chunk with its checksum.
fn chunk(name: [u8; 4], data: &[u8]) -> Vec<u8> {
    let mut checksum = u32::MAX;
    for &byte in name.iter().chain(data) {
        checksum ^= u32::from(byte);
        for _ in 0..8 {
            checksum = (checksum >> 1) ^ (0xedb8_8320 * (checksum & 1));
        }
    }
    [&(data.len() as u32).to_be_bytes(), &name[..], data, &(!checksum).to_be_bytes()].concat()
}

/// A PNG file of one bit a pixel that promises `width` × `height` pixels and holds none.
fn promised_png(width: u32, height: u32) -> Vec<u8> {
    let header = [&width.to_be_bytes()[..], &height.to_be_bytes(), &[1, 0, 0, 0, 0]].concat();
    let empty_stream = [0x78, 0x01, 0x03, 0x00, 0x00, 0x00, 0x00, 0x01];
    [
        b"\x89PNG\r\n\x1a\n".to_vec(),
        chunk(*b"IHDR", &header),
        chunk(*b"IDAT", &empty_stream),
        chunk(*b"IEND", &[]),
    ]
    .concat()
}

#[test]
fn a_missing_file_is_not_found() {
    let result = load_drawing("no/such/file.png", &DrawingOptions::default());
    assert_refused!(result, DrawingError::NotFound { path } if path == Path::new("no/such/file.png"));
}

#[test]
fn a_folder_is_unreadable() {
    let result = load_drawing(std::env::temp_dir(), &DrawingOptions::default());
    assert_refused!(result, DrawingError::Unreadable { .. });
}

#[test]
fn a_target_is_not_written_into_nowhere() {
    let result = write_png(&Bitmap::full(), "no/such/folder/target.png");
    assert_refused!(result, DrawingError::Unwritable { .. });
}

#[test]
fn a_file_of_another_kind_has_an_unknown_format() {
    assert_refused!(load_file("notes.txt", b"some notes"), DrawingError::UnknownFormat { .. });
}

#[test]
fn text_named_png_is_not_an_image() {
    assert_refused!(
        load_file("notes.png", b"some notes"),
        DrawingError::NotAnImage { format: DrawingFormat::Png }
    );
}

#[test]
fn a_png_is_not_a_jpeg() {
    assert_refused!(
        read(plain_png([0, 0, 0, 255]), DrawingFormat::Jpeg),
        DrawingError::NotAnImage { format: DrawingFormat::Jpeg }
    );
}

#[test]
fn an_empty_png_is_truncated() {
    assert_refused!(read(b"", DrawingFormat::Png), DrawingError::Truncated { .. });
}

#[test]
fn a_png_cut_anywhere_is_truncated() {
    let png = std::fs::read(asset("thumbs_up.png")).unwrap();
    for length in [4, 8, 20, 40, png.len() / 2, png.len() - 13, png.len() - 1] {
        assert_refused!(
            read(&png[..length], DrawingFormat::Png),
            DrawingError::Truncated { format: DrawingFormat::Png }
        );
    }
}

#[test]
fn a_jpeg_cut_anywhere_is_truncated() {
    let mut jpeg = Vec::new();
    image::codecs::jpeg::JpegEncoder::new(&mut jpeg)
        .encode(&[7; 64 * 64], 64, 64, image::ExtendedColorType::L8)
        .unwrap();
    for length in [2, 100, jpeg.len() / 2, jpeg.len() - 2, jpeg.len() - 1] {
        assert_refused!(
            read(&jpeg[..length], DrawingFormat::Jpeg),
            DrawingError::Truncated { format: DrawingFormat::Jpeg }
        );
    }
}

#[test]
fn a_png_with_a_broken_header_is_malformed() {
    let mut png = plain_png([0, 0, 0, 255]);
    // A byte of the header's checksum.
    png[30] ^= 1;
    assert_refused!(read(png, DrawingFormat::Png), DrawingError::Malformed { .. });
}

#[test]
fn a_png_without_its_pixels_is_refused() {
    let result = read(promised_png(200, 200), DrawingFormat::Png);
    assert_refused!(result, DrawingError::Malformed { .. } | DrawingError::Truncated { .. });
}

#[test]
fn a_png_of_a_hundred_megapixels_is_too_large() {
    assert_refused!(
        read(promised_png(10_000, 10_000), DrawingFormat::Png),
        DrawingError::TooLarge { unit: "pixels", found: 100_000_000, limit: 25_000_000 }
    );
}

#[test]
fn a_file_over_the_limit_is_too_large() {
    let mut bytes = target_to_png(&Bitmap::full()).unwrap();
    bytes.resize((64 << 20) + 1, 0);
    assert_refused!(read(bytes, DrawingFormat::Png), DrawingError::TooLarge { unit: "bytes", .. });
}

#[test]
fn an_exact_fit_refuses_an_image_of_another_size() {
    let picture = Picture { width_px: 100, height_px: 99, rgba: [0, 0, 0, 255].repeat(9900) };
    assert_refused!(
        read_exactly(picture.to_png().unwrap(), DrawingFormat::Png),
        DrawingError::WrongSize { height: 99.0, .. }
    );
}

#[test]
fn an_exact_fit_refuses_a_page_of_another_size() {
    let page = r#"<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 50 50">
        <path d="M0 0h9v9z"/></svg>"#;
    assert_refused!(
        read_exactly(page, DrawingFormat::Svg),
        DrawingError::WrongSize { width: 50.0, .. }
    );
}

#[test]
fn a_white_image_is_an_empty_target() {
    assert_refused!(read(plain_png([255; 4]), DrawingFormat::Png), DrawingError::EmptyTarget);
}

#[test]
fn a_black_image_without_margin_is_a_full_target() {
    let options = DrawingOptions { margin_px: 0.0, ..DrawingOptions::default() };
    let png = plain_png([0, 0, 0, 255]);
    let result = drawing_from_bytes(&png, DrawingFormat::Png, &options);
    assert_refused!(result, DrawingError::FullTarget);
}

#[test]
fn options_out_of_range_are_named() {
    let default = DrawingOptions::default();
    for (options, option) in [
        (DrawingOptions { margin_px: -1.0, ..default }, "margin_px"),
        (DrawingOptions { margin_px: f64::NAN, ..default }, "margin_px"),
        (DrawingOptions { margin_px: 50.0, ..default }, "margin_px"),
        (DrawingOptions { threshold: 0.0, ..default }, "threshold"),
        (DrawingOptions { threshold: 1.5, ..default }, "threshold"),
    ] {
        let result = load_drawing(asset("ellipse.svg"), &options);
        assert_refused!(result, DrawingError::InvalidOption { name, .. } if name == option);
    }
}

#[test]
fn an_svg_without_shapes_is_named() {
    assert_refused!(
        read_svg("<g><title>nothing</title></g>"),
        DrawingError::NoShapes { format: DrawingFormat::Svg }
    );
}

#[test]
fn an_svg_that_is_not_xml_is_malformed() {
    assert_refused!(read("<svg><path", DrawingFormat::Svg), DrawingError::Malformed { .. });
}

#[test]
fn an_svg_that_is_not_utf8_is_malformed() {
    assert_refused!(read(b"<svg>\xff</svg>", DrawingFormat::Svg), DrawingError::Malformed { .. });
}

#[test]
fn an_svg_of_no_size_is_malformed() {
    let page = r#"<svg xmlns="http://www.w3.org/2000/svg" width="0" height="0">
        <path d="M0 0h9v9z"/></svg>"#;
    assert_refused!(read(page, DrawingFormat::Svg), DrawingError::Malformed { .. });
}

#[test]
fn an_svg_with_an_image_from_disk_is_refused() {
    assert_refused!(
        read_svg(r#"<image xlink:href="/etc/hostname" width="9" height="9"/>"#),
        DrawingError::UnknownEntities { kinds, .. } if kinds == ["image"]
    );
}

#[test]
fn an_svg_entity_from_disk_is_not_loaded() {
    let page = r#"<!DOCTYPE svg [<!ENTITY host SYSTEM "file:///etc/hostname">]>
        <svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9"><text y="9">&host;</text></svg>"#;
    assert_refused!(read(page, DrawingFormat::Svg), DrawingError::Malformed { .. });
}

#[test]
fn an_svg_with_filters_is_refused() {
    let content = r#"<filter id="f"><feGaussianBlur stdDeviation="9"/></filter>
        <circle cx="50" cy="50" r="30" filter="url(#f)"/>"#;
    assert_refused!(
        read_svg(content),
        DrawingError::UnknownEntities { kinds, .. } if kinds == ["filter"]
    );
}

#[test]
fn svg_text_without_a_glyph_is_refused() {
    // A character for private use, for which fonts have no glyph.
    let text = "<text y=\"50\" font-size=\"40\">\u{10fffd}</text>";
    assert_refused!(read_svg(text), DrawingError::NoFont { .. });
}

#[test]
fn a_deeply_nested_svg_is_too_large() {
    let content = format!("{}<path d='M0 0h9v9z'/>{}", "<g>".repeat(5000), "</g>".repeat(5000));
    assert_refused!(read_svg(&content), DrawingError::TooLarge { .. });
}

#[test]
fn an_svg_of_references_to_references_is_too_large() {
    let groups: Vec<String> = (1..20)
        .map(|level| {
            let uses = format!(r##"<use href="#u{}"/>"##, level - 1).repeat(10);
            format!(r#"<g id="u{level}">{uses}</g>"#)
        })
        .collect();
    let content = format!(
        r##"<defs><path id="u0" d="M0 0h9v9z"/>{}</defs><use href="#u19"/>"##,
        groups.concat()
    );
    assert_refused!(read_svg(&content), DrawingError::TooLarge { .. });
}

#[test]
fn an_svg_of_entities_in_entities_is_refused() {
    let entities: Vec<String> = (1..20)
        .map(|level| {
            let below = format!("&e{};", level - 1).repeat(10);
            format!(r#"<!ENTITY e{level} "{below}">"#)
        })
        .collect();
    let page = format!(
        r#"<!DOCTYPE svg [<!ENTITY e0 "{}">{}]>
        <svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9">&e19;</svg>"#,
        "<g/>".repeat(10),
        entities.concat()
    );
    assert_refused!(read(page, DrawingFormat::Svg), DrawingError::Malformed { .. });
}

#[test]
fn an_svg_of_masks_in_masks_by_style_sheet_is_too_large() {
    let masks: Vec<String> = (0..20)
        .map(|level| {
            let class = format!("c{}", 99 + level);
            let squares = format!(r#"<path class="{class}" d="M0 0h9v9z"/>"#).repeat(4);
            format!(
                r#"<style>svg .c{} {{ mask: url(#m{level}) }}</style>
                <mask id="m{level}">{squares}</mask>"#,
                100 + level
            )
        })
        .collect();
    let content = format!(r#"{}<path class="c119" d="M0 0h9v9z"/>"#, masks.concat());
    assert_refused!(read_svg(&content), DrawingError::TooLarge { .. });
}

#[test]
fn an_svg_of_endless_text_is_too_large() {
    let text = format!(r#"<text y="50" font-size="9">{}</text>"#, "to and fro ".repeat(9000));
    assert_refused!(read_svg(&text), DrawingError::TooLarge { .. });
}

#[test]
fn an_svg_path_of_countless_edges_is_too_large() {
    let edges =
        format!(r#"<path stroke="black" d="M0 0{}"/>"#, "L1 99 99 3 2 98 97 1".repeat(30_000));
    assert_refused!(read_svg(&edges), DrawingError::TooLarge { .. });
}

#[test]
fn an_svg_of_a_long_entity_used_often_is_too_large() {
    let page = format!(
        r#"<!DOCTYPE svg [<!ENTITY long "{}">]>
        <svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9">{}</svg>"#,
        "h9v9".repeat(20_000),
        r#"<path d="M0 0&long;"/>"#.repeat(5000)
    );
    assert_refused!(read(page, DrawingFormat::Svg), DrawingError::TooLarge { .. });
}

#[test]
fn an_svg_line_of_countless_dashes_is_too_large() {
    let line =
        r#"<path d="M0 0H100" stroke="black" stroke-width="9" stroke-dasharray="0.000001"/>"#;
    assert_refused!(read_svg(line), DrawingError::TooLarge { .. });
}

#[test]
fn an_svg_with_a_boundless_radius_is_too_large() {
    let arc = r#"<path d="M-54 0a54 1e30 1 1 108 0a54 54 0 10 21 0z"/>"#;
    assert_refused!(read_svg(arc), DrawingError::TooLarge { limit: 1_000_000_000, .. });
}

#[test]
fn an_svg_with_a_shape_far_beyond_its_page_is_too_large() {
    let far = r#"<path d="M0 0h90v90z"/><path d="M0 0H9v999000000z"/>"#;
    assert_refused!(read_svg(far), DrawingError::TooLarge { limit: 1000, .. });
}

#[test]
fn an_svg_of_masks_far_larger_than_the_page_is_too_large() {
    let mask = r#"<mask id="m"><path fill="white" d="M-900-900h999v999h-999z"/></mask>"#;
    let layers = r#"<path mask="url(#m)" d="M-900-900h999v999h-999z"/>"#.repeat(9);
    assert_refused!(read_svg(&format!("{mask}{layers}")), DrawingError::TooLarge { .. });
}

#[test]
fn an_svg_of_countless_layers_is_too_large() {
    let layer = r#"<g opacity="0.9"><path d="M0 0h100v99z"/><path d="M0 0h100v100H0z"/></g>"#;
    assert_refused!(read_svg(&layer.repeat(3000)), DrawingError::TooLarge { .. });
}

#[test]
fn a_dxf_with_unknown_entities_names_them() {
    let entities = "0 CIRCLE 10 0 20 0 40 9 0 HATCH 70 1 0 3DSOLID 70 1 0 HATCH 70 1 0 TEXT 1 a";
    match read_dxf(entities) {
        Err(DrawingError::UnknownEntities { format: DrawingFormat::Dxf, kinds, supported }) => {
            assert_eq!(kinds, ["3DSOLID", "HATCH", "TEXT"]);
            assert!(supported.contains("LWPOLYLINE"));
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_dxf_entity_across_the_plane_is_named() {
    assert_refused!(
        read_dxf("0 CIRCLE 10 0 20 0 40 9 210 1 220 0 230 0"),
        DrawingError::UnknownEntities { kinds, .. } if kinds == ["CIRCLE out of the plane"]
    );
}

#[test]
fn an_open_contour_of_a_dxf_tells_its_gap() {
    let entities = "0 LINE 10 0 20 0 11 50 21 0 0 LINE 10 50 20 0 11 50 21 40 \
                    0 LINE 10 50 20 42 11 0 21 0";
    match read_dxf(entities) {
        Err(DrawingError::OpenContour { from, to, gap, tolerance }) => {
            let mut ends = [from[1], to[1]];
            ends.sort_by(f64::total_cmp);
            assert!((ends[0] - 40.0).abs() < 1e-9 && (ends[1] - 42.0).abs() < 1e-9);
            assert!((gap - 2.0).abs() < 1e-9 && tolerance < gap);
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_dxf_without_entities_has_no_shapes() {
    assert_refused!(read_dxf(""), DrawingError::NoShapes { format: DrawingFormat::Dxf });
}

#[test]
fn a_dxf_without_area_is_an_empty_target() {
    let there_and_back = "0 LWPOLYLINE 70 1 10 0 20 0 10 9 20 9";
    assert_refused!(read_dxf(there_and_back), DrawingError::EmptyTarget);
}

#[test]
fn a_dxf_cut_short_is_truncated() {
    let dxf = std::fs::read(asset("bracket.dxf")).unwrap();
    let lines: Vec<&[u8]> = dxf.split_inclusive(|&byte| byte == b'\n').collect();
    for length in [0, 1, 2, lines.len() / 2, lines.len() - 1] {
        assert_refused!(
            read(lines[..length].concat(), DrawingFormat::Dxf),
            DrawingError::Truncated { format: DrawingFormat::Dxf }
        );
    }
}

#[test]
fn a_binary_dxf_is_refused() {
    assert_refused!(
        read(b"AutoCAD Binary DXF\r\n\x1a\0", DrawingFormat::Dxf),
        DrawingError::Malformed { reason, .. } if reason.contains("binary")
    );
}

#[test]
fn a_dxf_with_a_group_code_that_is_no_number_is_malformed() {
    assert_refused!(read_dxf("zero LINE"), DrawingError::Malformed { .. });
}

#[test]
fn dxf_numbers_that_are_not_finite_are_malformed() {
    for number in ["nan", "inf", "1e300", "one"] {
        assert_refused!(
            read_dxf(&format!("0 CIRCLE 10 0 20 0 40 {number}")),
            DrawingError::Malformed { reason, .. } if reason.contains(number)
        );
    }
}

#[test]
fn a_dxf_circle_without_a_radius_is_malformed() {
    assert_refused!(read_dxf("0 CIRCLE 10 0 20 0"), DrawingError::Malformed { .. });
}

#[test]
fn a_dxf_circle_of_negative_radius_is_malformed() {
    assert_refused!(read_dxf("0 CIRCLE 10 0 20 0 40 -3"), DrawingError::Malformed { .. });
}

#[test]
fn a_dxf_spline_with_knots_missing_is_malformed() {
    assert_refused!(
        read_dxf("0 SPLINE 71 3 40 0 40 1 10 0 20 0 10 1 20 0 10 1 20 1 10 0 20 1"),
        DrawingError::Malformed { reason, .. } if reason.contains("knots")
    );
}

#[test]
fn a_dxf_spline_of_fit_points_only_is_named() {
    assert_refused!(
        read_dxf("0 SPLINE 71 3 11 0 21 0 11 1 21 0"),
        DrawingError::UnknownEntities { kinds, .. } if kinds == ["SPLINE without control points"]
    );
}

#[test]
fn a_dxf_block_that_is_missing_is_malformed() {
    assert_refused!(
        read_dxf("0 INSERT 2 nut 10 0 20 0"),
        DrawingError::Malformed { reason, .. } if reason.contains("block")
    );
}

#[test]
fn a_dxf_block_that_inserts_itself_is_too_large() {
    assert_refused!(
        read_dxf_file(
            "0 SECTION 2 BLOCKS 0 BLOCK 2 a 0 INSERT 2 a 10 0 20 0 0 INSERT 2 a 10 0 20 0 \
             0 ENDBLK 0 ENDSEC 0 SECTION 2 ENTITIES 0 INSERT 2 a 10 0 20 0 0 ENDSEC 0 EOF"
        ),
        DrawingError::TooLarge { .. }
    );
}

#[test]
fn a_dxf_array_of_countless_blocks_is_too_large() {
    assert_refused!(
        read_dxf_file(
            "0 SECTION 2 BLOCKS 0 BLOCK 2 a 0 POINT 10 0 20 0 0 ENDBLK 0 ENDSEC \
             0 SECTION 2 ENTITIES 0 INSERT 2 a 10 0 20 0 70 1000000 71 1000000 0 ENDSEC 0 EOF"
        ),
        DrawingError::TooLarge { .. }
    );
}
