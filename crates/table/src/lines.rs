//! Lines of a text in any encoding of [`problem::text`], in constant memory but for UTF-16.

use problem::Problem;
use std::io::{BufRead, Cursor, Read};

/// A line longer than this is not one of numbers.
pub(crate) const LONGEST: usize = 64 * 1024;

pub(crate) struct Lines<R> {
    input: R,
    /// UTF-16, decoded; read before `input`.
    decoded: Cursor<Vec<u8>>,
    bytes: Vec<u8>,
    count: usize,
}

impl<R: BufRead> Lines<R> {
    /// Takes the byte-order mark.
    pub(crate) fn new(mut input: R) -> Result<Self, Problem> {
        let mut start = Vec::new();
        let unreadable = |e| Problem::new(format!("cannot be read: {e}"), "");
        (input.by_ref().take(3).read_to_end(&mut start)).map_err(unreadable)?;
        if start.starts_with(&[0xFF, 0xFE]) || start.starts_with(&[0xFE, 0xFF]) {
            input.read_to_end(&mut start).map_err(unreadable)?;
            start = problem::text(start, "")?.into_bytes();
        } else if start == [0xEF, 0xBB, 0xBF] {
            start.clear();
        }
        Ok(Self {
            input,
            decoded: Cursor::new(start),
            bytes: Vec::new(),
            count: 0,
        })
    }

    /// Lines that were read.
    pub(crate) fn count(&self) -> usize {
        self.count
    }

    /// Adds the next line to `text`, without its end; false at the end.
    pub(crate) fn next(&mut self, text: &mut String) -> Result<bool, Problem> {
        self.bytes.clear();
        self.count += 1;
        let limit = LONGEST as u64;
        let mut source = self.decoded.by_ref().chain(self.input.by_ref()).take(limit);
        let read = source.read_until(b'\n', &mut self.bytes);
        let read = read.map_err(|e| Problem::new(format!("cannot be read: {e}"), ""))?;
        if read == 0 {
            return Ok(false);
        }
        if read >= LONGEST && !self.bytes.ends_with(b"\n") {
            let allowed = format!("at most {LONGEST} bytes");
            return Err(Problem::new("the line is too long", allowed));
        }
        while let [.., b'\n' | b'\r'] = self.bytes.as_slice() {
            self.bytes.pop();
        }
        match std::str::from_utf8(&self.bytes) {
            Ok(line) if !line.contains('\0') => text.push_str(line),
            _ => text.push_str(&problem::text(self.bytes.clone(), "")?),
        }
        Ok(true)
    }
}
