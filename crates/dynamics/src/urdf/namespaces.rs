//! Text that is common in URDFs, that other parsers read past, and that is no XML.
//!
//! Prefixes that a file uses without declaring them (`<drake:diaphragm/>` without `xmlns:drake`) get a declaration.
//! Blank lines before the XML declaration, hyphens in comments and document types without entities are blanked out.

use roxmltree::{Document, Error, Node};
use std::borrow::Cow;

/// More undeclared prefixes than a robot has extensions: each costs a reading of the text.
const MOST: usize = 32;

/// The text, with every prefix declared on the line of the root element.
pub(super) fn declared(text: &str) -> Result<Cow<'_, str>, Error> {
    let mut text = Cow::Borrowed(text);
    for _ in 0..MOST {
        match Document::parse(&text) {
            Ok(_) => break,
            Err(Error::UnknownNamespace(prefix, _)) => {
                let Some(at) = after_root_name(&text) else {
                    break;
                };
                let (before, after) = text.split_at(at);
                text = Cow::Owned(format!("{before} xmlns:{prefix}=\"{prefix}\"{after}"));
            }
            Err(e) => {
                let blanked = match e {
                    Error::UnexpectedDeclaration(_) => without_declaration(&text),
                    Error::InvalidComment(_) => without_hyphens(&text),
                    Error::DtdDetected => without_document_type(&text),
                    _ => None,
                };
                let Some(blanked) = blanked.filter(|blanked| *blanked != text) else {
                    return Err(e);
                };
                text = Cow::Owned(blanked);
            }
        }
    }
    Ok(text)
}

/// The text with one part of it blank; lines and places stay.
fn blanked(text: &str, begin: usize, end: usize) -> Option<String> {
    let part = text.get(begin..end)?;
    let blank: String = (part.bytes())
        .map(|byte| if byte == b'\n' { '\n' } else { ' ' })
        .collect();
    Some(format!("{}{blank}{}", text.get(..begin)?, text.get(end..)?))
}

/// The text without an XML declaration that follows blanks.
fn without_declaration(text: &str) -> Option<String> {
    let begin = text.len() - text.trim_start().len();
    let end = begin + text.get(begin..)?.strip_prefix("<?xml")?.find("?>")?;
    blanked(text, begin, end + "<?xml?>".len())
}

/// The text without hyphens inside comments.
fn without_hyphens(text: &str) -> Option<String> {
    let mut whole = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(at) = rest.find("<!") {
        let (before, mark) = rest.split_at(at);
        let (open, close) = if mark.starts_with("<!--") {
            ("<!--", "-->")
        } else if mark.starts_with("<![CDATA[") {
            ("<![CDATA[", "]]>")
        } else {
            ("<!", ">")
        };
        let (inside, behind) = mark.get(open.len()..)?.split_once(close)?;
        whole.push_str(before);
        whole.push_str(open);
        if close == "-->" {
            whole.push_str(&inside.replace('-', " "));
        } else {
            whole.push_str(inside);
        }
        whole.push_str(close);
        rest = behind;
    }
    Some(whole + rest)
}

/// The text without a document type, if that defines nothing.
fn without_document_type(text: &str) -> Option<String> {
    let begin = text.find("<!DOCTYPE")?;
    let end = begin + text.get(begin..)?.find(['>', '['])?;
    let closes = text.get(end..)?.starts_with('>');
    closes.then(|| blanked(text, begin, end + 1))?
}

/// True for elements of the robot's own vocabulary: `<drake:joint>` is no `<joint>`.
pub(super) fn plain(node: &Node) -> bool {
    let robot = node.document().root_element();
    node.is_element() && node.tag_name().namespace() == robot.tag_name().namespace()
}

/// Where the name in the root element's start tag ends.
fn after_root_name(text: &str) -> Option<usize> {
    let mut at = 0;
    loop {
        at += text.get(at..)?.find('<')?;
        let rest = text.get(at..)?;
        let end = match rest {
            _ if rest.starts_with("<!--") => "-->",
            _ if rest.starts_with("<?") => "?>",
            _ => {
                let name = rest.find(|c: char| c.is_whitespace() || c == '>' || c == '/')?;
                return Some(at + name);
            }
        };
        at += rest.find(end)? + end.len();
    }
}
