//! Object dictionaries as makers describe them: EDS and DCF files (CiA 306).

use super::Object;
use problem::{Problem, Problems};
use std::collections::BTreeMap;

/// A file is refused unread above this size: it is no description of a drive.
const MAX_TEXT: usize = 16 << 20;

/// The objects of a device.
#[derive(Clone, Debug, PartialEq)]
pub struct ObjectDictionary {
    /// The file's name as it was given.
    pub file: String,
    /// Identity, as far as the file has it.
    pub identity: FileIdentity,
    entries: BTreeMap<Object, Entry>,
}

/// A device's identity as its file has it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FileIdentity {
    /// Maker.
    pub vendor_name: String,
    /// Product.
    pub product_name: String,
    /// Number of the maker (object 1018:01).
    pub vendor: Option<u32>,
    /// Number of the product (object 1018:02).
    pub product: Option<u32>,
}

/// One entry.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// Name.
    pub name: String,
    /// Length, bits; none: text, domain, or a type of the maker's own.
    pub bits: Option<u8>,
    /// Type is a signed integer.
    pub signed: bool,
    /// Can be read.
    pub readable: bool,
    /// Can be written.
    pub writable: bool,
    /// Can be mapped to a PDO.
    pub mappable: bool,
    /// Value to set (DCF), or else the default, as written.
    pub value: Option<String>,
    /// Line of its section in the file, from 1.
    pub line: usize,
}

impl ObjectDictionary {
    /// Reads an EDS or DCF file; `file` only names it in errors.
    ///
    /// # Errors
    /// Text that has no objects, and entries without a type that is known.
    pub fn parse(text: &str, file: &str) -> Result<Self, Problems> {
        let allowed =
            "an EDS or DCF file: sections as [6041] with ParameterName, DataType, AccessType";
        if text.len() > MAX_TEXT {
            let problem = Problem::new("the file is too long", "at most 16 MiB");
            return Err(Problems(vec![problem.at(file, 0)]));
        }
        let sections = sections(text);
        let mut dictionary = Self {
            file: file.to_owned(),
            identity: FileIdentity::default(),
            entries: BTreeMap::new(),
        };
        let mut problems = Vec::new();
        let mut arrays = Vec::new();
        for section in &sections {
            if section.name == "deviceinfo" {
                dictionary.identity = section.identity();
            }
            let Some(object) = object_of(&section.name) else {
                continue;
            };
            if section
                .get("compactsubobj")
                .and_then(number)
                .is_some_and(|n| n > 0)
            {
                arrays.push((object, section));
                continue;
            }
            // An object with sub-indices has a section of its own, without a type.
            let Some(written) = section.get("datatype") else {
                continue;
            };
            match number(written) {
                Some(kind) => {
                    let entry = section.entry(kind);
                    dictionary.entries.insert(object, entry);
                }
                None => {
                    let what = format!("object {object} has data type {written:?}");
                    problems.push(Problem::new(what, "a number, as 0x0007").at(file, section.line));
                }
            }
        }
        for (object, section) in arrays {
            dictionary.add_array(object, section);
        }
        if dictionary.entries.is_empty() && problems.is_empty() {
            problems.push(Problem::new("no object is described", allowed).at(file, 0));
        }
        if problems.is_empty() {
            Ok(dictionary)
        } else {
            Err(Problems(problems))
        }
    }

    /// The entry of an object.
    #[must_use]
    pub fn entry(&self, object: Object) -> Option<&Entry> {
        self.entries.get(&object)
    }

    /// Number of entries.
    #[must_use]
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// It has no entries.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// Value of an object as the file has it; `$NODEID` is that of `node`.
    #[must_use]
    pub fn value(&self, object: Object, node: u8) -> Option<i64> {
        let text = self.entry(object)?.value.as_ref()?.to_ascii_lowercase();
        let (base, rest) = match text.split_once("$nodeid") {
            None => (0, text.as_str()),
            Some((before, after)) => {
                let rest = format!("{}{}", before.trim(), after.trim());
                let rest = rest.trim_matches('+').trim().to_owned();
                return Some(i64::from(node) + if rest.is_empty() { 0 } else { number(&rest)? });
            }
        };
        Some(base + number(rest)?)
    }

    /// An array whose entries are all alike (`CompactSubObj`).
    fn add_array(&mut self, object: Object, section: &Section) {
        let kind = section.get("datatype").and_then(number).unwrap_or(0);
        let count = section.get("compactsubobj").and_then(number).unwrap_or(0);
        let mut number_of = section.entry(0x05);
        (number_of.mappable, number_of.writable) = (false, false);
        self.entries.insert(object, number_of);
        for sub in 1..=count.clamp(0, 254) as u8 {
            let sub = Object::new(object.index, sub);
            self.entries.insert(sub, section.entry(kind));
        }
    }
}

/// One section, its keys in lower case.
struct Section {
    name: String,
    line: usize,
    keys: BTreeMap<String, String>,
}

impl Section {
    fn get(&self, key: &str) -> Option<&str> {
        self.keys
            .get(key)
            .map(String::as_str)
            .filter(|text| !text.is_empty())
    }

    fn text(&self, key: &str) -> String {
        self.get(key).unwrap_or_default().to_owned()
    }

    fn identity(&self) -> FileIdentity {
        let number = |key| {
            self.get(key)
                .and_then(number)
                .and_then(|n| u32::try_from(n).ok())
        };
        FileIdentity {
            vendor_name: self.text("vendorname"),
            product_name: self.text("productname"),
            vendor: number("vendornumber"),
            product: number("productnumber"),
        }
    }

    fn entry(&self, kind: i64) -> Entry {
        let (bits, signed) = type_of(kind);
        let access = self.get("accesstype").unwrap_or("rw").to_ascii_lowercase();
        let value = self
            .get("parametervalue")
            .or_else(|| self.get("defaultvalue"));
        Entry {
            name: self.text("parametername"),
            bits,
            signed,
            readable: access != "wo",
            writable: access.starts_with("rw") || access == "wo",
            mappable: self.get("pdomapping").and_then(number) == Some(1),
            value: value.map(str::to_owned),
            line: self.line,
        }
    }
}

/// Bits and sign of a basic data type (CiA 301, 7.4.7).
fn type_of(kind: i64) -> (Option<u8>, bool) {
    match kind {
        0x01 => (Some(1), false),
        0x02 => (Some(8), true),
        0x03 => (Some(16), true),
        0x04 => (Some(32), true),
        0x05 => (Some(8), false),
        0x06 => (Some(16), false),
        0x07 | 0x08 => (Some(32), false),
        0x10 => (Some(24), true),
        0x11 | 0x1B => (Some(64), false),
        0x15 => (Some(64), true),
        0x16 => (Some(24), false),
        _ => (None, false),
    }
}

/// `6041` or `6041sub2`.
fn object_of(name: &str) -> Option<Object> {
    let (index, sub) = match name.split_once("sub") {
        None => (name, 0),
        Some((index, sub)) => (index, u8::from_str_radix(sub, 16).ok()?),
    };
    if index.len() != 4 {
        return None;
    }
    Some(Object::new(u16::from_str_radix(index, 16).ok()?, sub))
}

/// A decimal, hexadecimal or octal number, as EDS files have them.
fn number(text: &str) -> Option<i64> {
    let text = text.trim();
    let (negative, digits) = match text.strip_prefix('-') {
        Some(digits) => (true, digits),
        None => (false, text),
    };
    let lower = digits.to_ascii_lowercase();
    let magnitude = if let Some(hex) = lower.strip_prefix("0x") {
        i64::from_str_radix(hex, 16).ok()?
    } else if lower.len() > 1 && lower.starts_with('0') && lower.chars().all(|c| c.is_digit(8)) {
        i64::from_str_radix(&lower, 8).ok()?
    } else {
        lower.parse().ok()?
    };
    Some(if negative { -magnitude } else { magnitude })
}

fn sections(text: &str) -> Vec<Section> {
    let mut sections = Vec::<Section>::new();
    for (line, content) in (1..).zip(text.trim_start_matches('\u{feff}').lines()) {
        let content = content.trim();
        if content.is_empty() || content.starts_with(';') || content.starts_with('#') {
            continue;
        }
        if let Some(name) = content
            .strip_prefix('[')
            .and_then(|rest| rest.split_once(']'))
        {
            sections.push(Section {
                name: name.0.trim().to_ascii_lowercase(),
                line,
                keys: BTreeMap::new(),
            });
        } else if let (Some(section), Some((key, value))) =
            (sections.last_mut(), content.split_once('='))
        {
            let key = key.trim().to_ascii_lowercase();
            section.keys.insert(key, value.trim().to_owned());
        }
    }
    sections
}
