//! Flat Parquet files: a column of numbers for each field, a page for each column of a row group.
//!
//! <https://parquet.apache.org/docs/file-format/>. The crate `parquet` would add twelve crates and a minute
//! of building on one core for what stands here.

use super::thrift::{Struct, put_count};
use recording::Kind;
use std::io::{self, Write};

/// Memory that the values of a row group take at most, bytes.
const GROUP: usize = 64 << 20;
/// Most rows of a row group.
const MOST_ROWS: usize = 100_000;
/// Level of compression of zstd: its default.
const LEVEL: i32 = 3;

const MAGIC: &[u8] = b"PAR1";
const ZSTD: i32 = 6;
const DATA_PAGE: i32 = 0;
const PLAIN: i32 = 0;
const RLE: i32 = 3;
const BYTE_STREAM_SPLIT: i32 = 9;

/// A column.
pub(super) struct Column {
    pub(super) name: String,
    pub(super) kind: Kind,
    /// A row may have no value.
    pub(super) optional: bool,
}

impl Column {
    /// Physical type, and converted type of integers without sign.
    fn types(&self) -> (i32, Option<i32>) {
        match self.kind {
            Kind::U8 => (1, Some(11)),
            Kind::U32 => (1, Some(13)),
            Kind::U64 => (2, Some(14)),
            Kind::F64 => (5, None),
        }
    }

    /// Bytes of a value in the file.
    fn width(&self) -> usize {
        match self.kind {
            Kind::U8 | Kind::U32 => 4,
            Kind::U64 | Kind::F64 => 8,
        }
    }

    fn encoding(&self) -> i32 {
        match self.kind {
            Kind::F64 => BYTE_STREAM_SPLIT,
            Kind::U8 | Kind::U32 | Kind::U64 => PLAIN,
        }
    }
}

/// A file that is being written, row by row.
pub(super) struct Writer<W> {
    out: W,
    at: u64,
    columns: Vec<Column>,
    /// Values of the row group, by column.
    values: Vec<Vec<Option<u64>>>,
    rows_of_group: usize,
    groups: Vec<Struct>,
    rows: u64,
}

impl<W: Write> Writer<W> {
    pub(super) fn new(out: W, columns: Vec<Column>) -> io::Result<Self> {
        let row = columns.len().max(1) * size_of::<Option<u64>>();
        let mut writer = Self {
            out,
            at: 0,
            values: columns.iter().map(|_| Vec::new()).collect(),
            rows_of_group: (GROUP / row).clamp(1, MOST_ROWS),
            columns,
            groups: Vec::new(),
            rows: 0,
        };
        writer.put(MAGIC)?;
        Ok(writer)
    }

    /// Takes a row: the bits of each column's value, none where it has none.
    pub(super) fn row(&mut self, values: impl Iterator<Item = Option<u64>>) -> io::Result<()> {
        for (column, value) in self.values.iter_mut().zip(values) {
            column.push(value);
        }
        self.rows += 1;
        if self.rows.is_multiple_of(self.rows_of_group as u64) {
            self.end_group()?;
        }
        Ok(())
    }

    /// Ends the file with its metadata.
    pub(super) fn finish(mut self, about: &[(&str, &str)]) -> io::Result<W> {
        if self.values.first().is_some_and(|column| !column.is_empty()) {
            self.end_group()?;
        }
        let root = Struct::default()
            .text(4, "schema")
            .i32(5, self.columns.len() as i32);
        let mut schema = vec![root];
        for column in &self.columns {
            let (physical, converted) = column.types();
            let element = Struct::default()
                .i32(1, physical)
                .i32(3, i32::from(column.optional))
                .text(4, &column.name);
            schema.push(match converted {
                Some(converted) => element.i32(6, converted),
                None => element,
            });
        }
        let pairs = about.iter();
        let pairs = pairs.map(|(key, value)| Struct::default().text(1, key).text(2, value));
        let metadata = Struct::default()
            .i32(1, 2)
            .structs(2, schema.into_iter())
            .i64(3, self.rows as i64)
            .structs(4, std::mem::take(&mut self.groups).into_iter())
            .structs(5, pairs)
            .text(6, concat!("torquectl ", env!("CARGO_PKG_VERSION")))
            .finish();
        self.put(&metadata)?;
        self.put(&(metadata.len() as u32).to_le_bytes())?;
        self.put(MAGIC)?;
        Ok(self.out)
    }

    fn end_group(&mut self) -> io::Result<()> {
        let mut chunks = Vec::new();
        let (mut total, mut rows) = (0, 0);
        for c in 0..self.columns.len() {
            let values = std::mem::take(&mut self.values[c]);
            let column = &self.columns[c];
            let page = page(column, &values);
            let compressed = zstd::bulk::compress(&page, LEVEL)?;
            let head = Struct::default()
                .i32(1, DATA_PAGE)
                .i32(2, page.len() as i32)
                .i32(3, compressed.len() as i32)
                .inner(
                    5,
                    Struct::default()
                        .i32(1, values.len() as i32)
                        .i32(2, column.encoding())
                        .i32(3, RLE)
                        .i32(4, RLE),
                )
                .finish();
            let at = self.at as i64;
            let sizes = [page.len(), compressed.len()].map(|len| (head.len() + len) as i64);
            let metadata = Struct::default()
                .i32(1, column.types().0)
                .integers(2, &[column.encoding(), RLE])
                .texts(3, &[&column.name])
                .i32(4, ZSTD)
                .i64(5, values.len() as i64)
                .i64(6, sizes[0])
                .i64(7, sizes[1])
                .i64(9, at);
            chunks.push(Struct::default().i64(2, at).inner(3, metadata));
            self.put(&head)?;
            self.put(&compressed)?;
            total += sizes[0];
            rows = values.len();
            // Its memory is used again.
            self.values[c] = values;
            self.values[c].clear();
        }
        let group = Struct::default().structs(1, chunks.into_iter());
        self.groups.push(group.i64(2, total).i64(3, rows as i64));
        Ok(())
    }

    fn put(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.at += bytes.len() as u64;
        self.out.write_all(bytes)
    }
}

/// The page of a column before compression: which rows have a value, and the values.
fn page(column: &Column, values: &[Option<u64>]) -> Vec<u8> {
    let mut page = Vec::new();
    if column.optional {
        let levels = levels(values);
        page.extend_from_slice(&(levels.len() as u32).to_le_bytes());
        page.extend(levels);
    }
    let there: Vec<u64> = values.iter().flatten().copied().collect();
    let width = column.width();
    match column.encoding() {
        // The first bytes of all values, then the second ones, and so on.
        BYTE_STREAM_SPLIT => {
            for byte in 0..width {
                page.extend(there.iter().map(|value| (value >> (8 * byte)) as u8));
            }
        }
        _ => {
            let bytes = there.iter().map(|value| value.to_le_bytes());
            bytes.for_each(|bytes| page.extend_from_slice(&bytes[..width]));
        }
    }
    page
}

/// Definition levels as runs of equal ones.
fn levels(values: &[Option<u64>]) -> Vec<u8> {
    let mut bytes = Vec::new();
    for run in values.chunk_by(|one, next| one.is_some() == next.is_some()) {
        put_count((run.len() as u64) << 1, &mut bytes);
        bytes.push(u8::from(run.first().is_some_and(Option::is_some)));
    }
    bytes
}
