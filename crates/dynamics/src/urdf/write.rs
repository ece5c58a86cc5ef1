//! A URDF's text with other inertias: nothing but `<inertial>` changes, comments and layout stay.

use super::namespaces::{declared, plain};
use super::problem_at;
use crate::spatial::Inertia;
use problem::{Problem, listed};
use roxmltree::{Document, Node};
use std::fmt::Write;
use std::ops::Range;

/// The text with these links' inertias, each about its link's frame. `file_name` is only used in
/// messages.
///
/// # Errors
/// Text that is not XML, or a link that it does not have.
pub fn urdf_with_inertias(
    text: &str,
    file_name: &str,
    inertias: &[(String, Inertia)],
) -> Result<String, Problem> {
    let in_file = |problem: Problem| {
        let line = problem.line;
        problem.at(file_name, line)
    };
    let not_xml = |e: &roxmltree::Error| {
        in_file(problem_at(
            e.pos().row as usize,
            format!("not XML: {e}"),
            "",
        ))
    };
    let whole = declared(text).map_err(|e| not_xml(&e))?;
    let document = Document::parse(&whole).map_err(|e| not_xml(&e))?;
    // Declarations were added behind the root's name, before every link.
    let added = whole.len() - text.len();
    let links: Vec<Node> = document
        .root_element()
        .children()
        .filter(|n| plain(n) && n.tag_name().name() == "link")
        .collect();
    let named = |name: &str| links.iter().find(|n| n.attribute("name") == Some(name));
    let mut edits: Vec<(Range<usize>, String)> = Vec::new();
    for (name, inertia) in inertias {
        let Some(link) = named(name) else {
            let names = links.iter().filter_map(|n| n.attribute("name"));
            return Err(in_file(problem_at(
                0,
                format!("no link \"{name}\""),
                listed(names),
            )));
        };
        let (range, text) = edit(link, &whole, inertia);
        edits.push((range.start - added..range.end - added, text));
    }
    edits.sort_by_key(|(range, _)| std::cmp::Reverse(range.start));
    let mut out = text.to_owned();
    for (range, replacement) in edits {
        out.replace_range(range, &replacement);
    }
    Ok(out)
}

/// Where a link's text changes, and to what.
fn edit(link: &Node, text: &str, inertia: &Inertia) -> (Range<usize>, String) {
    let own = link
        .children()
        .find(|c| plain(c) && c.tag_name().name() == "inertial");
    if let Some(old) = own {
        let range = old.range();
        return (
            range.clone(),
            element(inertia, &indentation(text, range.start)),
        );
    }
    let range = link.range();
    let indent = indentation(text, range.start);
    let inner = element(inertia, &format!("{indent}  "));
    let tag = start_tag(&text[range.clone()]);
    let end = range.start + tag;
    match text[..end].strip_suffix("/>") {
        Some(before) => (
            before.len()..end,
            format!(">\n{indent}  {inner}\n{indent}</link>"),
        ),
        None => (end..end, format!("\n{indent}  {inner}")),
    }
}

/// Length of an element's start tag; quoted text may hold `>`.
fn start_tag(element: &str) -> usize {
    let mut quote = None;
    for (at, c) in element.char_indices() {
        match (quote, c) {
            (None, '"' | '\'') => quote = Some(c),
            (Some(open), _) if open == c => quote = None,
            (None, '>') => return at + 1,
            _ => {}
        }
    }
    element.len()
}

/// White space before a place, from the beginning of its line.
fn indentation(text: &str, place: usize) -> String {
    let line = text[..place].rfind('\n').map_or(0, |at| at + 1);
    let before = &text[line..place];
    before.chars().take_while(|c| c.is_whitespace()).collect()
}

fn element(inertia: &Inertia, indent: &str) -> String {
    let (c, i) = (inertia.center(), inertia.central());
    let mut out = String::from("<inertial>\n");
    let _ = writeln!(
        out,
        "{indent}  <origin xyz=\"{} {} {}\" rpy=\"0 0 0\"/>",
        c.x, c.y, c.z
    );
    let _ = writeln!(out, "{indent}  <mass value=\"{}\"/>", inertia.mass);
    let _ = writeln!(
        out,
        "{indent}  <inertia ixx=\"{}\" ixy=\"{}\" ixz=\"{}\" iyy=\"{}\" iyz=\"{}\" izz=\"{}\"/>",
        i[(0, 0)],
        i[(0, 1)],
        i[(0, 2)],
        i[(1, 1)],
        i[(1, 2)],
        i[(2, 2)]
    );
    let _ = write!(out, "{indent}</inertial>");
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Base, Model};
    use nalgebra::{Matrix3, Vector3};

    const TEXT: &str = "<?xml version=\"1.0\"?>\n<robot name=\"r\">\n  <!-- kept > -->\n  <link name=\"base\"/>\n  <link name='a>b'>\n    <inertial><mass value=\"1\"/><inertia ixx=\"1\" iyy=\"1\" izz=\"1\"/></inertial>\n    <drake:x y=\"1\"/>\n  </link>\n  <joint name=\"j\" type=\"continuous\"><parent link=\"base\"/><child link=\"a>b\"/></joint>\n</robot>\n";

    #[test]
    fn only_inertias_change_and_are_read_back() {
        let central = Matrix3::new(0.03, 0.002, -1e-9, 0.002, 0.04, -0.003, -1e-9, -0.003, 0.05);
        let inertia = Inertia::from_central(1.0 / 3.0, Vector3::new(0.1, -1e-12, 7e5), central);
        let both = [("a>b".to_owned(), inertia), ("base".to_owned(), inertia)];
        let text = urdf_with_inertias(TEXT, "r.urdf", &both).unwrap();
        for kept in [
            "<!-- kept > -->",
            "<drake:x y=\"1\"/>",
            "<link name='a>b'>\n    <inertial>\n",
        ] {
            assert!(text.contains(kept), "{text}");
        }
        assert_eq!(text.matches("<inertial>").count(), 2);
        let model = Model::from_urdf(&text, "r.urdf", Base::Fixed).unwrap();
        for frame in model.frames() {
            assert_eq!(frame.inertia.mass, inertia.mass);
            assert!((frame.inertia.center() - inertia.center()).norm() < 1e-9);
            let difference = frame.inertia.rotational - inertia.rotational;
            assert!(difference.norm() <= 1e-12 * inertia.rotational.norm());
        }
        // Once more with the same: nothing changes any more.
        let again = urdf_with_inertias(&text, "r.urdf", &both).unwrap();
        assert_eq!(again, text);
        let unknown = [("c".to_owned(), inertia)];
        let refusal = urdf_with_inertias(TEXT, "r.urdf", &unknown).unwrap_err();
        assert_eq!(
            refusal.to_string(),
            "r.urdf: no link \"c\"; allowed: base, a>b"
        );
    }
}
