//! Files that take their names once they are whole.

use problem::Problem;
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// A file that is being written beside its place. [`NewFile::finish`] puts it there at once; until then, and for
/// good where it cannot be written to its end (a full disk) or the program ends, an older file of the name stays
/// whole. What is no file, as `/dev/stdout` and pipes, is written to directly.
pub struct NewFile {
    path: PathBuf,
    out: BufWriter<File>,
    /// The file that is to be renamed; none where there is nothing to rename, or it was done.
    partial: Option<PathBuf>,
}

impl NewFile {
    /// Begins a file that will be `path`, or replace it.
    ///
    /// # Errors
    /// It cannot be written there.
    pub fn create(path: &Path) -> Result<Self, Problem> {
        Self::begin(path).map_err(|e| Problem::unwritable(path.display(), &e))
    }

    fn begin(path: &Path) -> io::Result<Self> {
        let new = |file, partial| Self {
            path: path.to_owned(),
            out: BufWriter::new(file),
            partial,
        };
        // The file that a link names is replaced, not the link; a file that may not be written is not.
        let place = match OpenOptions::new().write(true).open(path) {
            Ok(file) if !file.metadata()?.is_file() => return Ok(new(file, None)),
            Ok(_) => path.canonicalize()?,
            Err(e) if e.kind() == io::ErrorKind::NotFound => path.to_owned(),
            Err(e) => return Err(e),
        };
        let name = place.file_name().ok_or(io::ErrorKind::IsADirectory)?;
        let name = format!(".{}.partial-{}", name.to_string_lossy(), std::process::id());
        let partial = place.with_file_name(name);
        let mut new = new(File::create(&partial)?, Some(partial.clone()));
        if let Ok(before) = fs::metadata(&place) {
            fs::set_permissions(&partial, before.permissions())?;
        }
        new.path = place;
        Ok(new)
    }

    /// Puts the whole file in its place.
    ///
    /// # Errors
    /// It could not be written to its end: nothing is left of it.
    pub fn finish(mut self) -> io::Result<()> {
        self.out.flush()?;
        let Some(partial) = &self.partial else {
            return Ok(());
        };
        self.out.get_ref().sync_all()?;
        fs::rename(partial, &self.path)?;
        self.partial = None;
        sync_folder(self.path.parent())
    }

    /// Ends it before it is whole: what was written stays beside its place, at the path that is given; none where
    /// it was written directly.
    pub fn keep_partial(mut self) -> Option<PathBuf> {
        // Data still in memory may not fit on the disk; it is worth a try.
        let _ = self.out.flush();
        self.partial.take()
    }
}

impl Write for NewFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.out.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }
}

impl Seek for NewFile {
    fn seek(&mut self, place: SeekFrom) -> io::Result<u64> {
        self.out.seek(place)
    }
}

impl Drop for NewFile {
    fn drop(&mut self) {
        if let Some(partial) = &self.partial {
            let _ = fs::remove_file(partial);
        }
    }
}

/// Waits until the names in a folder are on the disk; of the working folder, where the path is empty or none.
///
/// # Errors
/// The folder cannot be opened or written.
pub fn sync_folder(folder: Option<&Path>) -> io::Result<()> {
    let folder = folder.filter(|folder| !folder.as_os_str().is_empty());
    File::open(folder.unwrap_or(Path::new(".")))?.sync_all()
}

/// Writes new files, or replaces older ones: all are on the disk before the first takes its name, so that whoever is
/// interrupted while they are made and written leaves all older ones.
///
/// # Errors
/// One cannot be written: every older file stays as it was, unless a name cannot be taken.
pub fn write_files(files: &[(PathBuf, &str)]) -> Result<(), Problem> {
    let mut new = Vec::with_capacity(files.len());
    for (path, text) in files {
        let mut file = NewFile::create(path)?;
        let written = file.write_all(text.as_bytes());
        let written = written.and_then(|()| file.out.flush());
        let on_disk = written.and_then(|()| match file.partial {
            Some(_) => file.out.get_ref().sync_all(),
            None => Ok(()),
        });
        on_disk.map_err(|e| Problem::unwritable(path.display(), &e))?;
        new.push((file, path));
    }
    for (file, path) in new {
        let finished = file.finish();
        finished.map_err(|e| Problem::unwritable(path.display(), &e))?;
    }
    Ok(())
}

/// Writes a new file, or replaces one, at once.
///
/// # Errors
/// It cannot be written: an older file stays as it was.
pub fn write_file(path: &Path, text: &str) -> Result<(), Problem> {
    write_files(&[(path.to_owned(), text)])
}

#[cfg(test)]
mod tests {
    use super::{NewFile, write_file, write_files};
    use std::fs;
    use std::io::Write;
    use std::os::unix::fs::{PermissionsExt, symlink};
    use std::path::{Path, PathBuf};

    fn folder(test: &str) -> PathBuf {
        let name = format!("torqued-new-file-{}-{test}", std::process::id());
        let folder = std::env::temp_dir().join(name);
        let _ = fs::remove_dir_all(&folder);
        fs::create_dir_all(&folder).unwrap();
        folder
    }

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).unwrap();
        let mut names: Vec<_> = entries
            .map(|e| e.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    #[test]
    fn an_older_file_stays_until_the_new_one_is_whole() {
        let folder = folder("whole");
        let path = folder.join("a.csv");
        write_file(&path, "old").unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o640)).unwrap();
        let mut file = NewFile::create(&path).unwrap();
        file.write_all(&[b'x'; 100_000]).unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "old");
        drop(file);
        assert_eq!(fs::read_to_string(&path).unwrap(), "old");
        assert_eq!(names(&folder), ["a.csv"], "nothing half-written is left");
        write_file(&path, "new").unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "new");
        let mode = fs::metadata(&path).unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o640);
        fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn a_link_stays_a_link_and_what_is_no_file_is_written_directly() {
        let folder = folder("link");
        let (path, link) = (folder.join("a.csv"), folder.join("link.csv"));
        write_file(&path, "old").unwrap();
        symlink("a.csv", &link).unwrap();
        write_file(&link, "new").unwrap();
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(fs::read_to_string(&path).unwrap(), "new");
        write_file(Path::new("/dev/null"), "new").unwrap();
        assert!(!fs::metadata("/dev/null").unwrap().is_file());
        let refusal = write_file(Path::new("/dev/full"), "new").unwrap_err();
        assert!(refusal.reason.contains("cannot be written"), "{refusal:?}");
        assert!(write_file(&folder, "new").is_err());
        assert!(write_file(&folder.join("none/a.csv"), "new").is_err());
        fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn of_several_files_none_is_replaced_where_one_cannot_be_written() {
        let folder = folder("several");
        let [a, b] = ["a.csv", "b.csv"].map(|name| folder.join(name));
        write_files(&[(a.clone(), "old"), (b.clone(), "old")]).unwrap();
        let refusal = write_files(&[(a.clone(), "new"), ("/dev/full".into(), "new")]);
        assert!(refusal.unwrap_err().reason.contains("cannot be written"));
        assert_eq!(fs::read_to_string(&a).unwrap(), "old");
        write_files(&[(a.clone(), "new"), (b.clone(), "new")]).unwrap();
        assert_eq!(
            [&a, &b].map(|path| fs::read_to_string(path).unwrap()),
            ["new"; 2]
        );
        let mut file = NewFile::create(&a).unwrap();
        file.write_all(b"half").unwrap();
        let kept = file.keep_partial().unwrap();
        assert_eq!(fs::read_to_string(kept).unwrap(), "half");
        assert_eq!(fs::read_to_string(&a).unwrap(), "new");
        fs::remove_dir_all(folder).unwrap();
    }
}
