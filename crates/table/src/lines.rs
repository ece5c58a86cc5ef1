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
    /// End of a line: a line feed, or a carriage return in files of old Macintoshes.
    end: u8,
    /// The line that was read last ends with the file.
    at_end: bool,
    /// There was no line any more.
    ended: bool,
}

/// UTF-16 without its mark: the byte order that every second zero byte shows.
fn unmarked(start: &[u8]) -> Option<[u8; 2]> {
    let pairs = start.get(..8)?.chunks_exact(2);
    let ascii = |zero: usize| {
        let mut pairs = pairs.clone();
        pairs.all(|pair| pair[zero] == 0 && pair[1 - zero] != 0)
    };
    match (ascii(1), ascii(0)) {
        (true, _) => Some([0xFF, 0xFE]),
        (_, true) => Some([0xFE, 0xFF]),
        _ => None,
    }
}

impl<R: BufRead> Lines<R> {
    /// Takes the byte-order mark.
    pub(crate) fn new(mut input: R) -> Result<Self, Problem> {
        let mut start = Vec::new();
        let unreadable = |e| Problem::new(format!("cannot be read: {e}"), "");
        let ahead = input.fill_buf().map_err(unreadable)?;
        let mark = unmarked(ahead);
        let mut returns = ahead.contains(&b'\r') && !ahead.contains(&b'\n');
        start.extend(mark.into_iter().flatten());
        (input.by_ref().take(3).read_to_end(&mut start)).map_err(unreadable)?;
        if start.starts_with(&[0xFF, 0xFE]) || start.starts_with(&[0xFE, 0xFF]) {
            input.read_to_end(&mut start).map_err(unreadable)?;
            start = problem::text(start, "")?.into_bytes();
            returns = start.contains(&b'\r') && !start.contains(&b'\n');
        } else if start == [0xEF, 0xBB, 0xBF] {
            start.clear();
        }
        Ok(Self {
            input,
            decoded: Cursor::new(start),
            bytes: Vec::new(),
            count: 0,
            end: if returns { b'\r' } else { b'\n' },
            at_end: false,
            ended: false,
        })
    }

    /// Lines that were read.
    pub(crate) fn count(&self) -> usize {
        self.count
    }

    /// True if the line that was read last ends with the file, not with a line's end.
    pub(crate) fn at_end(&self) -> bool {
        self.at_end
    }

    /// Adds the next line to `text`, without its end; false at the end.
    pub(crate) fn next(&mut self, text: &mut String) -> Result<bool, Problem> {
        self.bytes.clear();
        // The end counts as one line, however often it is read.
        self.count += usize::from(!self.ended);
        let limit = LONGEST as u64;
        let mut source = self.decoded.by_ref().chain(self.input.by_ref()).take(limit);
        let read = source.read_until(self.end, &mut self.bytes);
        let read = read.map_err(|e| Problem::new(format!("cannot be read: {e}"), ""))?;
        self.ended = read == 0;
        if self.ended {
            return Ok(false);
        }
        self.at_end = !self.bytes.ends_with(&[self.end]);
        if read >= LONGEST && self.at_end {
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
