//! Formats of logs, by the bytes that a file begins with.

use problem::Problem;
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Formats of a log.
pub(super) enum Format {
    /// MCAP.
    Mcap,
    /// rosbag2's SQLite.
    Sqlite,
    /// A table.
    Text,
}

/// Bytes that other formats begin with, what they are, and what converts them (`{log}`: the file).
const OTHERS: [(&[u8], &str, &str); 15] = [
    (
        &[0x28, 0xB5, 0x2F, 0xFD],
        "is compressed with zstd",
        "what `zstd -d {log}` writes",
    ),
    (
        &[0x1F, 0x8B],
        "is compressed with gzip",
        "what `gunzip -k {log}` writes",
    ),
    (
        b"BZh",
        "is compressed with bzip2",
        "what `bunzip2 -k {log}` writes",
    ),
    (
        &[0xFD, b'7', b'z', b'X', b'Z'],
        "is compressed with xz",
        "what `unxz -k {log}` writes",
    ),
    (
        &[0x04, 0x22, 0x4D, 0x18],
        "is compressed with LZ4",
        "what `lz4 -d {log}` writes",
    ),
    (
        b"PK\x03\x04",
        "is a ZIP archive or a spreadsheet",
        "CSV, as spreadsheets export it",
    ),
    (
        &[0xD0, 0xCF, 0x11, 0xE0],
        "is a spreadsheet of an old format",
        "CSV, as spreadsheets export it",
    ),
    (
        b"PAR1",
        "is a Parquet file",
        "CSV, as pandas' `to_csv` writes it",
    ),
    (
        b"ARROW1",
        "is a Feather file",
        "CSV, as pandas' `to_csv` writes it",
    ),
    (
        b"\x89HDF",
        "is a file of HDF5 or MATLAB",
        "CSV, as `writetable` writes it",
    ),
    (
        b"MATLAB 5.0",
        "is a file of HDF5 or MATLAB",
        "CSV, as `writetable` writes it",
    ),
    (
        b"\x93NUMPY",
        "is a file of numpy",
        "CSV, as `numpy.savetxt` writes it",
    ),
    (b"ULog", "is a log of PX4", "CSV, as `ulog2csv` writes it"),
    (b"MDF ", "is an MDF file", "CSV, as `asammdf` exports it"),
    (b"{", "is JSON", "CSV, as pandas' `to_csv` writes it"),
];

impl Format {
    /// By the bytes that a file begins with.
    ///
    /// # Errors
    /// A file that cannot be read, or of a known format that is not: with what converts it.
    pub(super) fn of(path: &Path) -> Result<Self, Problem> {
        let log = path.display().to_string();
        if path.is_dir() {
            let allowed = "a file; of a recording of rosbag2 the .mcap or .db3 in its folder";
            return Err(Problem::new("is a folder", allowed).at(log, 0));
        }
        let unreadable = |e: std::io::Error| Problem::unreadable(&log, &e);
        let mut start = Vec::new();
        let file = File::open(path).map_err(unreadable)?;
        file.take(16).read_to_end(&mut start).map_err(unreadable)?;
        let begins = |magic: &[u8]| start.starts_with(magic);
        let refuse = |what: &str, allowed: String| Err(Problem::new(what, allowed).at(&log, 0));
        if begins(b"#ROSBAG V") {
            return refuse("is a bag of ROS 1", by_rosbags(path));
        }
        if let Some((_, what, allowed)) = OTHERS.iter().find(|(magic, ..)| begins(magic)) {
            return refuse(what, allowed.replace("{log}", &log));
        }
        if begins(b"\x89MCAP0\r\n") || path.extension().is_some_and(|e| e == "mcap") {
            return Ok(Self::Mcap);
        }
        if begins(b"SQLite format 3\0") {
            return Ok(Self::Sqlite);
        }
        Ok(Self::Text)
    }
}

/// The command that makes MCAP of a recording.
pub(super) fn by_rosbags(path: &Path) -> String {
    let (log, to) = (path.display(), path.with_extension(""));
    let to = to.display();
    format!(
        "the MCAP file that `pip install rosbags && rosbags-convert --src {log} --dst {to} \
         --dst-storage mcap` writes in {to}"
    )
}
