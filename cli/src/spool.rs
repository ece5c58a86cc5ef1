//! Columns of numbers that are too many for memory: they lie in a file without a name, which goes with the last
//! column that lies in it.

use problem::Problem;
use std::env;
use std::fs::File;
use std::io;
use std::ops::Range;
use std::os::unix::fs::FileExt;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};

/// Numbers of a part, which lie together in the file and are read at once: a page of the disk's cache. A part of each
/// column is in memory, of 300 columns in each stretch of a run.
pub(crate) const PART: usize = 512;
const BYTES: usize = size_of::<f64>();
/// Parts of a spool that stay in memory: two megabytes, so that short recordings need no disk.
const KEPT: usize = (2 << 20) / (PART * BYTES);

/// The file.
pub(crate) struct Spool {
    file: File,
    /// Its length, bytes.
    end: AtomicU64,
    /// Full parts that stay in memory.
    kept: AtomicUsize,
}

/// A full part.
enum Part {
    Memory(Vec<f64>),
    /// Its place in the file, bytes.
    File(u64),
}

/// A column of numbers.
pub(crate) struct Column {
    spool: Arc<Spool>,
    /// The full parts.
    parts: Vec<Part>,
    /// What follows them.
    rest: Vec<f64>,
}

/// The folder of such files: they are too large for a /tmp that is memory.
fn folder() -> PathBuf {
    env::var_os("TMPDIR").map_or_else(|| PathBuf::from("/var/tmp"), PathBuf::from)
}

fn problem(error: &io::Error) -> Problem {
    let reason = format!("the numbers of a recording cannot be kept on the disk: {error}");
    let allowed = "TMPDIR=FOLDER with room for about twice the recording";
    Problem::new(reason, allowed).at(folder().display().to_string(), 0)
}

impl Spool {
    /// An empty one, in the folder TMPDIR or else /var/tmp.
    ///
    /// # Errors
    /// A folder in which no file can be made.
    pub(crate) fn new() -> Result<Arc<Self>, Problem> {
        let file = tempfile::tempfile_in(folder()).map_err(|e| problem(&e))?;
        Ok(Arc::new(Self {
            file,
            end: AtomicU64::new(0),
            kept: AtomicUsize::new(0),
        }))
    }

    /// Takes a full part.
    fn keep(&self, values: &[f64]) -> Result<Part, Problem> {
        if self.kept.fetch_add(1, Ordering::Relaxed) < KEPT {
            return Ok(Part::Memory(values.to_vec()));
        }
        let at = self.end.fetch_add((PART * BYTES) as u64, Ordering::Relaxed);
        self.write(values, at)?;
        Ok(Part::File(at))
    }

    fn write(&self, values: &[f64], at: u64) -> Result<(), Problem> {
        let bytes: Vec<u8> = values.iter().flat_map(|x| x.to_ne_bytes()).collect();
        self.file.write_all_at(&bytes, at).map_err(|e| problem(&e))
    }
}

impl Column {
    /// An empty one.
    pub(crate) fn new(spool: &Arc<Spool>) -> Self {
        Self {
            spool: Arc::clone(spool),
            parts: Vec::new(),
            rest: Vec::new(),
        }
    }

    /// One with these values.
    ///
    /// # Errors
    /// A disk that is full.
    pub(crate) fn of(spool: &Arc<Spool>, values: &[f64]) -> Result<Self, Problem> {
        let mut column = Self::new(spool);
        column.extend(values)?;
        Ok(column)
    }

    pub(crate) fn len(&self) -> usize {
        PART * self.parts.len() + self.rest.len()
    }

    /// Adds a value at the end.
    ///
    /// # Errors
    /// A disk that is full.
    pub(crate) fn push(&mut self, value: f64) -> Result<(), Problem> {
        self.rest.push(value);
        if self.rest.len() == PART {
            self.parts.push(self.spool.keep(&self.rest)?);
            self.rest.clear();
        }
        Ok(())
    }

    /// Adds values at the end.
    ///
    /// # Errors
    /// A disk that is full.
    pub(crate) fn extend(&mut self, values: &[f64]) -> Result<(), Problem> {
        values.iter().try_for_each(|x| self.push(*x))
    }

    /// Reads the part `k`, the `PART` values from `k * PART` on, or as many as there are, into `into`.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub(crate) fn read_part(&self, k: usize, into: &mut Vec<f64>) -> Result<(), Problem> {
        into.clear();
        let at = match self.parts.get(k) {
            Some(Part::File(at)) => at,
            Some(Part::Memory(values)) => {
                into.extend_from_slice(values);
                return Ok(());
            }
            None => {
                into.extend(self.rest.iter().filter(|_| k == self.parts.len()));
                return Ok(());
            }
        };
        let mut bytes = [0; PART * BYTES];
        (self.spool.file.read_exact_at(&mut bytes, *at)).map_err(|e| problem(&e))?;
        let (values, _) = bytes.as_chunks::<BYTES>();
        into.extend(values.iter().map(|x| f64::from_ne_bytes(*x)));
        Ok(())
    }

    /// All values.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub(crate) fn read(&self) -> Result<Vec<f64>, Problem> {
        let (mut all, mut part) = (Vec::with_capacity(self.len()), Vec::new());
        for k in 0..=self.parts.len() {
            self.read_part(k, &mut part)?;
            all.extend_from_slice(&part);
        }
        Ok(all)
    }

    /// Other values in place of all, as many as there are.
    ///
    /// # Errors
    /// A file that cannot be written or read.
    pub(crate) fn change(
        &mut self,
        with: impl FnOnce(&mut Vec<f64>) -> Result<(), Problem>,
    ) -> Result<(), Problem> {
        let mut values = self.read()?;
        with(&mut values)?;
        let (parts, rest) = values.as_chunks::<PART>();
        for (values, part) in parts.iter().zip(&mut self.parts) {
            match part {
                Part::Memory(kept) => kept.copy_from_slice(values),
                Part::File(at) => self.spool.write(values, *at)?,
            }
        }
        self.rest = rest.to_vec();
        Ok(())
    }

    /// Leaves out all but a range.
    ///
    /// # Errors
    /// As [`Self::change`].
    pub(crate) fn cut(&mut self, kept: Range<usize>) -> Result<(), Problem> {
        let values = self.read()?;
        *self = Self::of(&self.spool, values.get(kept).unwrap_or_default())?;
        Ok(())
    }
}

/// Size from which freed memory goes back to the system at once, bytes: that of a column of nine minutes at 1 kHz. By
/// itself the allocator raises this bound to whatever was freed, and keeps up to a fifth more than is in use.
#[cfg(target_env = "gnu")]
const RETURNED: i32 = 4 << 20;

/// Gives the memory of long columns back as soon as they go.
pub(crate) fn return_memory() {
    // SAFETY: sets a number in the allocator; called before there are other threads.
    #[cfg(target_env = "gnu")]
    unsafe {
        libc::mallopt(libc::M_MMAP_THRESHOLD, RETURNED);
    }
}

/// Calls `row` with the values of all columns, row by row.
///
/// # Errors
/// A file that cannot be read; those of `row`.
pub(crate) fn each_row(
    columns: &[&Column],
    mut row: impl FnMut(usize, &[f64]) -> Result<(), Problem>,
) -> Result<(), Problem> {
    let count = columns.first().map_or(0, |column| column.len());
    let mut parts = vec![Vec::new(); columns.len()];
    let mut values = vec![0.0; columns.len()];
    for i in 0..count {
        if i % PART == 0 {
            for (part, column) in parts.iter_mut().zip(columns) {
                column.read_part(i / PART, part)?;
            }
        }
        for (value, part) in values.iter_mut().zip(&parts) {
            *value = part.get(i % PART).copied().unwrap_or(f64::NAN);
        }
        row(i, &values)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_hold_what_they_were_given_bit_by_bit() {
        let spool = Spool::new().unwrap();
        // The last ones no longer find room in memory.
        let long = (KEPT + 3) * PART + 7;
        for count in [0, 1, PART - 1, PART, PART + 1, 3 * PART + 7, long, long + 1] {
            let of = |scale: f64| -> Vec<f64> { (0..count).map(|k| scale / k as f64).collect() };
            let (a, b) = (of(1.0), of(-0.3));
            let mut columns = [Column::new(&spool), Column::new(&spool)];
            for (x, y) in a.iter().zip(&b) {
                columns[0].push(*x).unwrap();
                columns[1].push(*y).unwrap();
            }
            let bits = |x: &[f64]| x.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
            assert_eq!(bits(&columns[0].read().unwrap()), bits(&a));
            assert_eq!(columns[1].len(), count);
            let mut rows = Vec::new();
            each_row(&[&columns[0], &columns[1]], |i, row| {
                assert_eq!(i, rows.len());
                rows.push([row[0].to_bits(), row[1].to_bits()]);
                Ok(())
            })
            .unwrap();
            let expected = a.iter().zip(&b).map(|(x, y)| [x.to_bits(), y.to_bits()]);
            assert_eq!(rows, expected.collect::<Vec<_>>());

            let double = |values: &mut Vec<f64>| {
                values.iter_mut().for_each(|x| *x *= 2.0);
                Ok(())
            };
            columns[0].change(double).unwrap();
            assert_eq!(bits(&columns[0].read().unwrap()), bits(&of(2.0)));
            let kept = count / 3..count - count / 4;
            columns[1].cut(kept.clone()).unwrap();
            assert_eq!(bits(&columns[1].read().unwrap()), bits(&b[kept]));
        }
    }
}
