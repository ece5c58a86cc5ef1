//! `torquectl export`: a recorded run as CSV, a line for each cycle.

use crate::output::{apart, finish_or_refuse};
use crate::recorded;
use problem::{Problem, Problems};
use recording::{Counts, Field, Fields, Header};
use std::io::{self, BufWriter, StdoutLock, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use terminal::NewFile;
use torqued_client::robot_state::{CycleRecord, Reference};
use zerocopy::IntoBytes;

const HELP: &str = "\
Columns are the numbers of every cycle's record, by their names there, joints and F/T sensors by name,
with the unit in brackets: measured.joints[knee].q [rad]. The first column is the time since the first
cycle. --fields chooses by the beginning of the name or of its last part: `tau_hat`, `measured.joints`,
`q`. References are under reference.; they are empty while no client commands.

Examples:
  torquectl export run.mcap -o run.csv --joint knee
  torquectl export run.mcap -o run.csv --joint knee --fields q,theta,current,tau_encoder
  torquectl export run.mcap --fields measured.ft | head
  torquectl export run.mcap --list

Exit codes:
  0  written
  2  bad input: no such joint or field, not a recorded run, a file that cannot be written";

/// Write a recorded run as CSV.
#[derive(clap::Args)]
#[command(after_help = HELP)]
pub(crate) struct ExportArguments {
    /// The recorded run
    run: PathBuf,
    /// The CSV file; without it standard output
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Only this joint; may be repeated
    #[arg(long, value_name = "NAME")]
    joint: Vec<String>,
    /// Only these fields
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    fields: Vec<String>,
    /// List the fields, with units and meanings, and end
    #[arg(long)]
    list: bool,
}

pub(crate) fn run(arguments: &ExportArguments) -> ExitCode {
    finish_or_refuse(export(arguments))
}

/// Where the lines go.
enum Out {
    File(NewFile),
    Standard(BufWriter<StdoutLock<'static>>),
}

impl Out {
    fn finish(self) -> io::Result<()> {
        match self {
            Self::File(file) => file.finish(),
            Self::Standard(mut out) => out.flush(),
        }
    }
}

impl Write for Out {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Self::File(file) => file.write(bytes),
            Self::Standard(out) => out.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::File(file) => file.flush(),
            Self::Standard(out) => out.flush(),
        }
    }
}

/// A column: a number of the record or of the reference.
struct Column {
    field: Field,
    of_reference: bool,
    title: String,
}

fn export(arguments: &ExportArguments) -> Result<String, Problems> {
    let mut run = recorded::open(&arguments.run)?;
    let columns = columns(run.header(), arguments)?;
    if arguments.list {
        let lines = columns
            .iter()
            .map(|column| format!("{}: {}\n", column.title, column.field.meaning(run.header())));
        return Ok(lines.collect());
    }
    let unwritable = |error: io::Error| {
        let path = arguments
            .output
            .clone()
            .unwrap_or_else(|| "standard output".into());
        Problem::unwritable(path.display(), &error)
    };
    let mut out = match &arguments.output {
        Some(path) => {
            apart(path, std::slice::from_ref(&arguments.run))?;
            Out::File(NewFile::create(path)?)
        }
        None => Out::Standard(BufWriter::new(io::stdout().lock())),
    };
    let titles: Vec<&str> = columns.iter().map(|column| column.title.as_str()).collect();
    let mut cycles = 0_u64;
    let mut begin_ns = None;
    let mut written = writeln!(out, "time [s],{}", titles.join(","));
    let path = arguments.run.clone();
    let ending = recorded::read_all(&path, &mut run, |_, message| {
        let record = &message.record.cycle;
        let begin_ns = *begin_ns.get_or_insert(record.stamp_ns);
        let mut line = format!(
            "{:.9}",
            recorded::ms_between(begin_ns, record.stamp_ns) * 1e-3
        );
        let reference = message.reference();
        for column in &columns {
            line.push(',');
            match (column.of_reference, reference) {
                (false, _) => line += &column.field.text(record.as_bytes()),
                (true, Some(reference)) => line += &column.field.text(reference.as_bytes()),
                (true, None) => {}
            }
        }
        cycles += 1;
        if written.is_ok() {
            written = writeln!(out, "{line}");
        }
        Ok(())
    })?;
    let written = written.and_then(|()| out.finish());
    match written {
        // The reader of the output closed the pipe, as `head` does.
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => return Ok(String::new()),
        other => other.map_err(unwritable)?,
    }
    eprint!("{}", recorded::describe_ending(&ending));
    Ok(match &arguments.output {
        Some(path) => written_to(path, cycles, columns.len()),
        None => String::new(),
    })
}

fn written_to(path: &Path, cycles: u64, columns: usize) -> String {
    format!(
        "{}: {cycles} cycles, {columns} columns and the time\n",
        path.display()
    )
}

fn columns(header: &Header, arguments: &ExportArguments) -> Result<Vec<Column>, Problem> {
    for joint in &arguments.joint {
        if !header.joints.contains(joint) {
            let problem = Problem::new(
                format!("the run has no joint {joint:?}"),
                header.joints.join(", "),
            );
            return Err(problem.of("--joint"));
        }
    }
    let counts: Counts = header.counts();
    let column = |of_reference: bool| {
        move |field: Field| {
            let unit = field.unit(header);
            let unit = unit.map_or_else(String::new, |unit| format!(" [{unit}]"));
            let before = if of_reference { "reference." } else { "" };
            let title = format!("{before}{}{unit}", field.named(header));
            Column {
                field,
                of_reference,
                title,
            }
        }
    };
    let records = Fields::new::<CycleRecord>(counts)
        .0
        .into_iter()
        .map(column(false));
    let references = Fields::new::<Reference>(counts)
        .0
        .into_iter()
        .map(column(true));
    let all: Vec<Column> = records.chain(references).collect();
    for name in &arguments.fields {
        if !all.iter().any(|column| is_named(column, name)) {
            let problem = Problem::new(
                format!("there is no field {name:?}"),
                "those that --list shows",
            );
            return Err(problem.of("--fields"));
        }
    }
    let chosen = |column: &Column| {
        let field = &column.field;
        let of_joint = field.joint.and_then(|j| header.joints.get(j));
        let joint = arguments.joint.is_empty()
            || of_joint.is_some_and(|joint| arguments.joint.contains(joint));
        let fields = &arguments.fields;
        joint && (fields.is_empty() || fields.iter().any(|name| is_named(column, name)))
    };
    Ok(all.into_iter().filter(chosen).collect())
}

/// By the beginning of its path, or by a whole part of it.
fn is_named(column: &Column, name: &str) -> bool {
    let path = if column.of_reference {
        format!("reference.{}", column.field.path)
    } else {
        column.field.path.clone()
    };
    let part = |part: &str| part == name || part.split('[').next() == Some(name);
    path.starts_with(name) || path.split('.').any(part)
}
