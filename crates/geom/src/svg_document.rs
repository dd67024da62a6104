//! Parsing SVG documents with nothing loaded from outside but fonts.

use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use resvg::usvg::{self, FontResolver, ImageHrefResolver, fontdb, roxmltree};

use crate::{DrawingError, DrawingFormat};

/// Largest number of XML nodes of a document.
const MAX_NODES: u32 = 200_000;

/// A parsed document: every shape, with text as outlines and all transforms resolved.
pub(crate) struct SvgDocument {
    /// The shapes, in units of the document's page.
    pub(crate) tree: usvg::Tree,
    /// Width and height of the page in user units: of the view box where there is one.
    pub(crate) user_size: [f64; 2],
}

impl SvgDocument {
    /// Parses `svg`. References to files and embedded pictures are left out.
    pub(crate) fn parse(svg: &str) -> Result<Self, DrawingError> {
        Self::from_xml(&parse_xml(svg)?)
    }

    /// Builds the shapes of an XML document that was parsed with [`parse_xml`].
    pub(crate) fn from_xml(xml: &roxmltree::Document<'_>) -> Result<Self, DrawingError> {
        let has_text = xml.descendants().any(|node| node.tag_name().name() == "text");
        let fonts = if has_text { system_fonts() } else { Arc::default() };
        Self::with_fonts(xml, fonts)
    }

    fn with_fonts(
        xml: &roxmltree::Document<'_>,
        fonts: Arc<fontdb::Database>,
    ) -> Result<Self, DrawingError> {
        let missing = Mutex::new(None);
        let options = usvg::Options {
            fontdb: fonts,
            font_family: "sans-serif".into(),
            font_resolver: reporting_resolver(&missing),
            image_href_resolver: ImageHrefResolver {
                resolve_data: Box::new(|_, _, _| None),
                resolve_string: Box::new(|_, _| None),
            },
            ..usvg::Options::default()
        };
        let tree = usvg::Tree::from_xmltree(xml, &options).map_err(|error| malformed(&error))?;
        drop(options);
        if let Some(text) = missing.into_inner().unwrap_or_else(PoisonError::into_inner) {
            return Err(DrawingError::NoFont { text });
        }
        let page = [f64::from(tree.size().width()), f64::from(tree.size().height())];
        let user_size = view_box_size(xml).unwrap_or(page);
        Ok(Self { tree, user_size })
    }
}

/// Stack of the thread that reads a document: elements nest, and each level takes a few kilobytes.
const STACK_BYTES: usize = 128 << 20;

/// Runs `read` on a thread of its own with a large stack. Should the SVG library panic on a
/// document, the document is refused.
pub(crate) fn isolated<T: Send>(
    read: impl FnOnce() -> Result<T, DrawingError> + Send,
) -> Result<T, DrawingError> {
    std::thread::scope(|scope| {
        let reader = std::thread::Builder::new()
            .name("svg".into())
            .stack_size(STACK_BYTES)
            .spawn_scoped(scope, read)
            .map_err(|source| DrawingError::NoThread { source })?;
        reader.join().unwrap_or_else(|_| {
            Err(DrawingError::Malformed {
                format: DrawingFormat::Svg,
                reason: "it breaks the SVG library".into(),
            })
        })
    })
}

/// Parses `svg` as XML with a limit on its nodes.
pub(crate) fn parse_xml(svg: &str) -> Result<roxmltree::Document<'_>, DrawingError> {
    let options = roxmltree::ParsingOptions {
        allow_dtd: true,
        nodes_limit: MAX_NODES,
        ..roxmltree::ParsingOptions::default()
    };
    roxmltree::Document::parse_with_options(svg, options).map_err(|error| match error {
        roxmltree::Error::NodesLimitReached => DrawingError::TooLarge {
            unit: "XML nodes",
            found: u64::from(MAX_NODES) + 1,
            limit: u64::from(MAX_NODES),
        },
        error => malformed(&error),
    })
}

fn malformed(error: &impl ToString) -> DrawingError {
    DrawingError::Malformed { format: DrawingFormat::Svg, reason: error.to_string() }
}

/// Width and height of the root's `viewBox`, user units.
fn view_box_size(xml: &roxmltree::Document<'_>) -> Option<[f64; 2]> {
    let numbers: Vec<f64> = xml
        .root_element()
        .attribute("viewBox")?
        .split(|c: char| c == ',' || c.is_ascii_whitespace())
        .filter_map(|number| number.parse().ok())
        .collect();
    match numbers[..] {
        [_, _, width, height] => Some([width, height]),
        _ => None,
    }
}

/// The fonts of this machine, searched once.
fn system_fonts() -> Arc<fontdb::Database> {
    static FONTS: OnceLock<Arc<fontdb::Database>> = OnceLock::new();
    let load = || {
        let mut fonts = fontdb::Database::new();
        fonts.load_system_fonts();
        Arc::new(fonts)
    };
    Arc::clone(FONTS.get_or_init(load))
}

/// Selects fonts as usvg does, falls back to any upright font, and notes in `missing` what no font
/// can set.
fn reporting_resolver(missing: &Mutex<Option<String>>) -> FontResolver<'_> {
    let note = move |text: String| {
        if let Ok(mut missing) = missing.lock() {
            missing.get_or_insert(text);
        }
    };
    let select = FontResolver::default_font_selector();
    let fall_back = FontResolver::default_fallback_selector();
    FontResolver {
        select_font: Box::new(move |font, fonts| {
            let upright = |fonts: &fontdb::Database| {
                let faces = fonts.faces();
                faces.filter(|face| face.style == fontdb::Style::Normal).map(|face| face.id).next()
            };
            let found = select(font, fonts).or_else(|| upright(fonts));
            if found.is_none() {
                let families: Vec<_> = font.families().iter().map(ToString::to_string).collect();
                note(format!("the family {}", families.join(", ")));
            }
            found
        }),
        select_fallback: Box::new(move |character, used, fonts| {
            let found = fall_back(character, used, fonts);
            if found.is_none() && !character.is_whitespace() && !character.is_control() {
                note(format!("the character {character:?}"));
            }
            found
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_without_any_font_is_reported() {
        let svg = r#"<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 40 20">
            <text x="2" y="15" font-family="Gothic">gym</text></svg>"#;
        let result = SvgDocument::with_fonts(&parse_xml(svg).unwrap(), Arc::default());
        match result.map(|document| document.user_size) {
            Err(DrawingError::NoFont { text }) => assert!(text.contains("Gothic"), "{text}"),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn the_view_box_gives_the_user_units() {
        let svg = r#"<svg xmlns="http://www.w3.org/2000/svg" width="10mm" height="5mm"
            viewBox="-5,-5 200 100"><path d="M0 0h1v1z"/></svg>"#;
        let [width, height] = SvgDocument::parse(svg).unwrap().user_size;
        assert!((width - 200.0).abs() + (height - 100.0).abs() < 1e-9);
    }
}
