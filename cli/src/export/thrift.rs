//! Thrift's compact protocol, as far as the metadata of Parquet need it.
//!
//! <https://github.com/apache/thrift/blob/master/doc/specs/thrift-compact-protocol.md>

const I32: u8 = 5;
const I64: u8 = 6;
const BINARY: u8 = 8;
const LIST: u8 = 9;
const STRUCT: u8 = 12;

/// A struct that is being written, field by field with increasing numbers.
#[derive(Default)]
pub(super) struct Struct {
    bytes: Vec<u8>,
    last: u8,
}

impl Struct {
    pub(super) fn i32(mut self, field: u8, value: i32) -> Self {
        self.head(field, I32);
        put_integer(i64::from(value), &mut self.bytes);
        self
    }

    pub(super) fn i64(mut self, field: u8, value: i64) -> Self {
        self.head(field, I64);
        put_integer(value, &mut self.bytes);
        self
    }

    pub(super) fn text(mut self, field: u8, text: &str) -> Self {
        self.head(field, BINARY);
        put_text(text, &mut self.bytes);
        self
    }

    pub(super) fn inner(mut self, field: u8, inner: Self) -> Self {
        self.head(field, STRUCT);
        self.bytes.extend(inner.finish());
        self
    }

    pub(super) fn structs(
        mut self,
        field: u8,
        elements: impl ExactSizeIterator<Item = Self>,
    ) -> Self {
        self.list(field, STRUCT, elements.len());
        for element in elements {
            self.bytes.extend(element.finish());
        }
        self
    }

    pub(super) fn integers(mut self, field: u8, elements: &[i32]) -> Self {
        self.list(field, I32, elements.len());
        for element in elements {
            put_integer(i64::from(*element), &mut self.bytes);
        }
        self
    }

    pub(super) fn texts(mut self, field: u8, elements: &[&str]) -> Self {
        self.list(field, BINARY, elements.len());
        for element in elements {
            put_text(element, &mut self.bytes);
        }
        self
    }

    /// Its bytes.
    pub(super) fn finish(mut self) -> Vec<u8> {
        self.bytes.push(0);
        self.bytes
    }

    fn head(&mut self, field: u8, kind: u8) {
        // A step of at most fifteen stands in the same byte; none of Parquet's structs needs more.
        self.bytes.push((field - self.last) << 4 | kind);
        self.last = field;
    }

    fn list(&mut self, field: u8, kind: u8, len: usize) {
        self.head(field, LIST);
        match len {
            0..15 => self.bytes.push((len as u8) << 4 | kind),
            _ => {
                self.bytes.push(0xf0 | kind);
                put_count(len as u64, &mut self.bytes);
            }
        }
    }
}

/// An unsigned integer in groups of seven bits, the lowest first.
pub(super) fn put_count(mut value: u64, bytes: &mut Vec<u8>) {
    while value > 127 {
        bytes.push(value as u8 | 128);
        value >>= 7;
    }
    bytes.push(value as u8);
}

fn put_integer(value: i64, bytes: &mut Vec<u8>) {
    put_count((value << 1 ^ value >> 63) as u64, bytes);
}

fn put_text(text: &str, bytes: &mut Vec<u8>) {
    put_count(text.len() as u64, bytes);
    bytes.extend_from_slice(text.as_bytes());
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The examples of the protocol's specification.
    #[test]
    fn integers_fields_and_lists_are_as_specified() {
        let mut bytes = Vec::new();
        put_count(50_399, &mut bytes);
        assert_eq!(bytes, [0xdf, 0x89, 0x03]);
        for (value, zigzag) in [(0, 0), (-1, 1), (1, 2), (-2, 3), (2, 4)] {
            let mut bytes = Vec::new();
            put_integer(value, &mut bytes);
            assert_eq!(bytes, [zigzag]);
        }
        let own = Struct::default()
            .i32(1, 1)
            .text(4, "a")
            .integers(5, &[1; 15]);
        let mut expected = vec![0x15, 2, 0x38, 1, b'a', 0x19, 0xf5, 15];
        expected.extend([2; 15]);
        expected.push(0);
        assert_eq!(own.finish(), expected);
    }
}
