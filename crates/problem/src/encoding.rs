//! One rule for the encoding of every text that is read, whoever wrote it.
//!
//! A byte-order mark decides (UTF-8, UTF-16). Without one a text with a byte 0 is UTF-16 if most of it is
//! ASCII then. Any other is UTF-8 if it can be, and otherwise Windows-1252, which programs under Windows write (CANdb++
//! among them) and which holds Latin-1.

use crate::{Problem, line_in};

/// The encodings that [`text`] reads, for messages.
pub const ENCODINGS: &str = "text in UTF-8, UTF-16 or Windows-1252";

/// Characters of Windows-1252 at bytes 0x80 to 0x9F; 0 where it has none. Others are those of Latin-1,
/// whose bytes are their code points. Source: Unicode's table CP1252.TXT.
const WINDOWS_1252: [u16; 32] = [
    0x20AC, 0, 0x201A, 0x0192, 0x201E, 0x2026, 0x2020, 0x2021, 0x02C6, 0x2030, 0x0160, 0x2039,
    0x0152, 0, 0x017D, 0, 0, 0x2018, 0x2019, 0x201C, 0x201D, 0x2022, 0x2013, 0x2014, 0x02DC,
    0x2122, 0x0161, 0x203A, 0x0153, 0, 0x017E, 0x0178,
];

/// The text that these bytes of a file are, without byte-order mark; `file` only names it in messages.
///
/// # Errors
/// Bytes of no such encoding, with their line: binary data, UTF-16 cut within a character, and
/// UTF-8 with a damaged character.
pub fn text(bytes: Vec<u8>, file: &str) -> Result<String, Problem> {
    match bytes.as_slice() {
        [0xFF, 0xFE, rest @ ..] => return utf_16(rest, file, u16::from_le_bytes),
        [0xFE, 0xFF, rest @ ..] => return utf_16(rest, file, u16::from_be_bytes),
        _ => {}
    }
    let from = if bytes.starts_with(&[0xEF, 0xBB, 0xBF]) {
        3
    } else {
        0
    };
    let body = bytes.get(from..).unwrap_or_default();
    if let Some(place) = body.iter().position(|byte| *byte == 0) {
        if let Some(text) = unmarked_utf_16(body) {
            return Ok(text);
        }
        let reason = "is no text: it holds a byte 0";
        return Err(Problem::new(reason, ENCODINGS).at(file, line_in(body, place)));
    }
    match core::str::from_utf8(body) {
        Ok(text) => Ok(text.to_owned()),
        Err(error) => {
            let place = error.valid_up_to();
            // A mark, or other characters in UTF-8, show that UTF-8 is meant.
            let is_utf8 = from > 0 || !body.get(..place).unwrap_or_default().is_ascii();
            let decoded = if is_utf8 { None } else { windows_1252(body) };
            decoded.ok_or_else(|| {
                let undefined = |byte: &u8| windows_1252(&[*byte]).is_none();
                let first = body.iter().position(undefined).unwrap_or(place);
                let place = if is_utf8 { place } else { first };
                let byte = body.get(place).copied().unwrap_or_default();
                let whose = if is_utf8 {
                    "UTF-8, in which the text before it is"
                } else {
                    "UTF-8 or Windows-1252"
                };
                let reason = format!("byte 0x{byte:02X} belongs to no character of {whose}");
                Problem::new(reason, ENCODINGS).at(file, line_in(body, place))
            })
        }
    }
}

/// None where a byte has no character.
fn windows_1252(bytes: &[u8]) -> Option<String> {
    let character = |byte: &u8| match byte {
        0x80..=0x9F => {
            let code = WINDOWS_1252.get(usize::from(byte - 0x80)).copied();
            code.filter(|code| *code > 0)
                .and_then(|code| char::from_u32(u32::from(code)))
        }
        _ => Some(char::from(*byte)),
    };
    bytes.iter().map(character).collect()
}

/// UTF-16 without a mark: a text in it has no character 0, and most of its characters are ASCII.
fn unmarked_utf_16(bytes: &[u8]) -> Option<String> {
    let orders: [fn([u8; 2]) -> u16; 2] = [u16::from_le_bytes, u16::from_be_bytes];
    orders.into_iter().find_map(|unit| {
        let text = utf_16(bytes, "", unit).ok()?;
        let ascii = text.chars().filter(char::is_ascii).count();
        (2 * ascii > text.chars().count() && !text.contains('\0')).then_some(text)
    })
}

fn utf_16(bytes: &[u8], file: &str, unit: fn([u8; 2]) -> u16) -> Result<String, Problem> {
    let pairs = bytes.chunks(2).map(|pair| match *pair {
        [a, b] => Some(unit([a, b])),
        _ => None,
    });
    let units: Option<Vec<u16>> = pairs.collect();
    let decoded = units.and_then(|units| String::from_utf16(&units).ok());
    decoded.ok_or_else(|| {
        let reason = "begins as UTF-16 and is damaged";
        Problem::new(reason, ENCODINGS).at(file, 0)
    })
}

#[cfg(test)]
mod tests {
    use super::text;

    fn read(bytes: &[u8]) -> String {
        text(bytes.to_vec(), "f").unwrap()
    }

    fn refusal(bytes: &[u8]) -> String {
        text(bytes.to_vec(), "f").unwrap_err().to_string()
    }

    #[test]
    fn every_usual_encoding_is_read() {
        assert_eq!(read("t,\u{e9}\n".as_bytes()), "t,\u{e9}\n");
        assert_eq!(read("\u{feff}t,\u{b0}".as_bytes()), "t,\u{b0}");
        assert_eq!(
            read(b"M\xFCller \xB0C \x80 \x93x\x94"),
            "M\u{fc}ller \u{b0}C \u{20ac} \u{201c}x\u{201d}"
        );
        for mark in [[0xFF, 0xFE], [0xFE, 0xFF]] {
            let units = "t;q;\u{b0}\u{1d70f}".encode_utf16();
            let bytes = units.flat_map(|unit| {
                if mark[0] == 0xFF {
                    unit.to_le_bytes()
                } else {
                    unit.to_be_bytes()
                }
            });
            let bytes: Vec<u8> = mark.into_iter().chain(bytes).collect();
            assert_eq!(read(&bytes), "t;q;\u{b0}\u{1d70f}");
            assert_eq!(read(&bytes[2..]), "t;q;\u{b0}\u{1d70f}");
        }
        assert_eq!(read(b""), "");
    }

    #[test]
    fn what_is_no_text_is_refused_with_its_line() {
        assert!(refusal(b"a\nb\0").starts_with("f:2: is no text"));
        let undefined = refusal(b"a\nb\n\xE9 \x81");
        assert!(
            undefined.starts_with("f:3: byte 0x81 belongs to no character of UTF-8 or"),
            "{undefined}"
        );
        let damaged = refusal(b"\xC2\xB0C\nx\xFCy");
        assert!(
            damaged.starts_with("f:2: byte 0xFC belongs to no character of UTF-8, in"),
            "{damaged}"
        );
        assert!(refusal(b"\xEF\xBB\xBFx\xFC").starts_with("f:1: byte 0xFC"));
        assert!(refusal(b"\xFF\xFEa").contains("UTF-16 and is damaged"));
    }
}
