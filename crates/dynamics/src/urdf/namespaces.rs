//! Prefixes that a file uses without declaring them (`<drake:diaphragm/>` without `xmlns:drake`):
//! common in URDFs, and no XML. Pinocchio's parser knows no namespaces and reads past them; here they
//! get a declaration.

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
            Err(e) => return Err(e),
        }
    }
    Ok(text)
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
