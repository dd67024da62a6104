//! What the references of an SVG document expand to, bounded before they are followed.
//!
//! A short document may expand to an endless one: entities in its text, and references to references
//! among its elements (`use`, clip paths, masks) by attribute or by style sheet.

use std::collections::{HashMap, HashSet};

use resvg::usvg::roxmltree;

use crate::{DrawingError, DrawingFormat};

/// Largest size of a document with each reference replaced by what it refers to, bytes.
const MAX_EXPANDED_BYTES: u64 = 32 << 20;

/// An element without attributes counts as this many bytes.
const ELEMENT_BYTES: u64 = 64;

/// A character of text counts as this many bytes: it takes a font, and becomes an outline.
const CHARACTER_BYTES: u64 = 4096;

/// Refuses document types with more than plain entities, and entities that expand to more than
/// [`MAX_EXPANDED_BYTES`].
pub(crate) fn check_entities(svg: &str) -> Result<(), DrawingError> {
    let Some(declarations) = document_type(svg)? else { return Ok(()) };
    let references = svg[declarations.end..].matches('&').count() as u64;
    check_expanded(references.saturating_mul(declarations.len() as u64))
}

/// The place of the document type, where one declares entities.
fn document_type(svg: &str) -> Result<Option<std::ops::Range<usize>>, DrawingError> {
    let (Some(start), Some(_)) = (svg.find("<!DOCTYPE"), svg.find("<!ENTITY")) else {
        return Ok(None);
    };
    let mut quote = None;
    for (k, character) in svg.char_indices().skip_while(|&(k, _)| k <= start) {
        let plain = match (quote, character) {
            // Entities in entities grow exponentially.
            (Some(_), '&') => false,
            (Some(open), _) => {
                quote = quote.filter(|_| character != open);
                true
            }
            (None, '"' | '\'') => {
                quote = Some(character);
                true
            }
            (None, '<') => svg[k..].starts_with("<!ENTITY"),
            (None, ']') => return Ok(Some(start..k)),
            (None, _) => true,
        };
        if !plain {
            break;
        }
    }
    Err(DrawingError::Malformed {
        format: DrawingFormat::Svg,
        reason: "its document type has more than plain entities".into(),
    })
}

/// Refuses documents whose references expand to more than [`MAX_EXPANDED_BYTES`].
pub(crate) fn check_expansion(xml: &roxmltree::Document<'_>) -> Result<(), DrawingError> {
    let by_id = xml.descendants().filter_map(|node| Some((node.attribute("id")?, node))).collect();
    let styles = xml.descendants().filter(|node| node.tag_name().name() == "style");
    let rules = styles.filter_map(|node| node.text()).flat_map(rules).collect();
    let mut expansion = Expansion { by_id, rules, known: HashMap::new(), open: HashSet::new() };
    check_expanded(expansion.bytes(xml.root()))
}

fn check_expanded(found: u64) -> Result<(), DrawingError> {
    if found > MAX_EXPANDED_BYTES {
        return Err(DrawingError::TooLarge {
            unit: "bytes once its references are resolved",
            found,
            limit: MAX_EXPANDED_BYTES,
        });
    }
    Ok(())
}

/// Sizes of elements with their references resolved.
struct Expansion<'a, 'input> {
    by_id: HashMap<&'a str, roxmltree::Node<'a, 'input>>,
    rules: Vec<Rule<'a>>,
    known: HashMap<roxmltree::NodeId, u64>,
    /// The elements under way: a reference back to them is no content.
    open: HashSet<roxmltree::NodeId>,
}

impl<'a, 'input> Expansion<'a, 'input> {
    fn bytes(&mut self, node: roxmltree::Node<'a, 'input>) -> u64 {
        if let Some(&bytes) = self.known.get(&node.id()) {
            return bytes;
        }
        if !self.open.insert(node.id()) {
            return 0;
        }
        let mut bytes = ELEMENT_BYTES + node.text().map_or(0, |text| text.len() as u64);
        if node.tag_name().name() == "text" {
            let texts = node.descendants().filter(roxmltree::Node::is_text);
            let characters: usize = texts.filter_map(|text| text.text()).map(str::len).sum();
            bytes = bytes.saturating_add(CHARACTER_BYTES.saturating_mul(characters as u64));
        }
        let mut ids = Vec::new();
        for attribute in node.attributes() {
            bytes = bytes.saturating_add(attribute.value().len() as u64);
            ids.extend(references(attribute.name(), attribute.value()));
        }
        let applied = self.rules.iter().filter(|rule| rule.may_apply(node));
        ids.extend(applied.flat_map(|rule| references("style", rule.declarations)));
        for id in ids {
            if let Some(&target) = self.by_id.get(id) {
                bytes = bytes.saturating_add(self.bytes(target));
            }
        }
        for child in node.children() {
            bytes = bytes.saturating_add(self.bytes(child));
        }
        self.open.remove(&node.id());
        self.known.insert(node.id(), bytes);
        bytes
    }
}

/// The ids an attribute refers to: `href="#id"` and each `url(#id)`.
fn references<'a>(name: &str, value: &'a str) -> impl Iterator<Item = &'a str> {
    let href = (name == "href").then(|| value.trim().strip_prefix('#')).flatten();
    let urls = value.split("url(").skip(1).filter_map(|rest| {
        let id = rest.split(')').next()?.trim().trim_matches(['"', '\'']).trim();
        id.strip_prefix('#')
    });
    href.into_iter().chain(urls)
}

/// A rule of a style sheet that refers to elements.
struct Rule<'a> {
    selector: &'a str,
    declarations: &'a str,
}

/// The rules of a style sheet with a reference in their declarations.
fn rules(style_sheet: &str) -> impl Iterator<Item = Rule<'_>> {
    style_sheet.split('}').filter_map(|rule| {
        let (selector, declarations) = rule.rsplit_once('{')?;
        declarations.contains("url(").then_some(Rule { selector, declarations })
    })
}

impl Rule<'_> {
    /// Whether the rule may apply to `node`: never false when it does.
    fn may_apply(&self, node: roxmltree::Node<'_, '_>) -> bool {
        let class_names = node.attribute("class").unwrap_or_default();
        let classes: Vec<&str> = class_names.split_ascii_whitespace().collect();
        self.selector.split(',').any(|selector| {
            let selector = selector.trim_end();
            // The last part of the selector speaks of the element, those before of its ancestors.
            let part = selector.rsplit(|c: char| c.is_ascii_whitespace() || "+~>{".contains(c));
            let part = part.into_iter().next().unwrap_or_default();
            let name_end = |c: char| !(c.is_alphanumeric() || c == '-' || c == '_');
            if let Some((_, class)) = part.split_once('.') {
                let class = class.split(name_end).next().unwrap_or_default();
                class.is_empty() || part.contains('\\') || classes.contains(&class)
            } else {
                part.contains(name_end) || part.is_empty() || part == node.tag_name().name()
            }
        })
    }
}
