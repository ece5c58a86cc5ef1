//! `torquectl export`: a recorded run as CSV or Parquet, a row for each cycle.

mod parquet;
mod thrift;

use crate::output::{apart, finish_or_refuse};
use crate::recorded;
use problem::{Problem, Problems};
use recording::{Counts, CycleMessage, Field, Fields, Header, Kind};
use std::io::{self, BufWriter, StdoutLock, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use terminal::NewFile;
use torqued_client::robot_state::{Content, CycleRecord, Reference};
use zerocopy::IntoBytes;

const HELP: &str = "\
Columns are the numbers of every cycle's record, by their names there, joints and F/T sensors by name,
with the unit in brackets: measured.joints[knee].q [rad]. The first column is the time since the first
cycle. --fields chooses by the beginning of the name or of its last part: `tau_hat`, `measured.joints`,
`q`. References are under reference.; they are empty while no client commands. A file whose name ends in
.parquet becomes a Parquet file, with the same names: pandas, Polars and DuckDB read it.

Examples:
  torquectl export run.mcap -o run.csv --joint knee
  torquectl export run.mcap -o run.csv --joint knee --fields q,theta,current,tau_encoder
  torquectl export run.mcap -o run.parquet
  torquectl export run.mcap --fields measured.ft | head
  torquectl export run.mcap --list

Exit codes:
  0  written
  2  bad input: no such joint or field, not a recorded run, a file that cannot be written";

/// Write a recorded run as CSV or Parquet.
#[derive(clap::Args)]
#[command(after_help = HELP)]
pub(crate) struct ExportArguments {
    /// The recorded run
    run: PathBuf,
    /// The file, CSV or, by its ending, .parquet; without it CSV on standard output
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

/// Where the rows go.
enum Out {
    Csv(NewFile),
    Standard(BufWriter<StdoutLock<'static>>),
    Parquet(Box<parquet::Writer<NewFile>>),
}

impl Out {
    fn create(
        output: Option<&PathBuf>,
        run: &PathBuf,
        columns: &[Column],
    ) -> Result<Self, Problem> {
        let Some(path) = output else {
            return Ok(Self::Standard(BufWriter::new(io::stdout().lock())));
        };
        apart(path, std::slice::from_ref(run))?;
        let file = NewFile::create(path)?;
        if path.extension().is_none_or(|ending| ending != "parquet") {
            return Ok(Self::Csv(file));
        }
        let own = columns.iter().map(|column| parquet::Column {
            name: column.title.clone(),
            kind: column.field.kind,
            optional: column.of_reference,
        });
        let time = parquet::Column {
            name: TIME.to_owned(),
            kind: Kind::F64,
            optional: false,
        };
        let writer = parquet::Writer::new(file, std::iter::once(time).chain(own).collect());
        let writer = writer.map_err(|error| Problem::unwritable(path.display(), &error))?;
        Ok(Self::Parquet(Box::new(writer)))
    }

    fn head(&mut self, columns: &[Column]) -> io::Result<()> {
        let titles: Vec<&str> = columns.iter().map(|column| column.title.as_str()).collect();
        match self {
            Self::Csv(file) => writeln!(file, "{TIME},{}", titles.join(",")),
            Self::Standard(out) => writeln!(out, "{TIME},{}", titles.join(",")),
            Self::Parquet(_) => Ok(()),
        }
    }

    fn row(&mut self, time_s: f64, columns: &[Column], message: &CycleMessage) -> io::Result<()> {
        let (record, reference) = (message.record.cycle.as_bytes(), message.reference());
        let bytes = |column: &Column| {
            if column.of_reference {
                reference.map(IntoBytes::as_bytes)
            } else {
                Some(record)
            }
        };
        if let Self::Parquet(writer) = self {
            let values = columns.iter();
            let values = values.map(|column| Some(column.field.bits(bytes(column)?)));
            return writer.row(std::iter::once(Some(time_s.to_bits())).chain(values));
        }
        let mut line = format!("{time_s:.9}");
        for column in columns {
            line.push(',');
            if let Some(bytes) = bytes(column) {
                line += &column.field.text(bytes);
            }
        }
        match self {
            Self::Csv(file) => writeln!(file, "{line}"),
            Self::Standard(out) => writeln!(out, "{line}"),
            Self::Parquet(_) => Ok(()),
        }
    }

    fn finish(self, header: &Header) -> io::Result<()> {
        match self {
            Self::Csv(file) => file.finish(),
            Self::Standard(mut out) => out.flush(),
            Self::Parquet(writer) => {
                let about = [
                    ("robot", header.robot.as_str()),
                    ("torqued", &header.version),
                ];
                writer.finish(&about)?.finish()
            }
        }
    }
}

/// Title of the first column.
const TIME: &str = "time [s]";

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
    let mut out = Out::create(arguments.output.as_ref(), &arguments.run, &columns)?;
    let mut cycles = 0_u64;
    let mut begin_ns = None;
    let mut written = out.head(&columns);
    let path = arguments.run.clone();
    let ending = recorded::read_all(&path, &mut run, |_, message| {
        let stamp_ns = message.record.cycle.stamp_ns;
        let begin_ns = *begin_ns.get_or_insert(stamp_ns);
        let time_s = recorded::ms_between(begin_ns, stamp_ns) * 1e-3;
        cycles += 1;
        if written.is_ok() {
            written = out.row(time_s, &columns, message);
        }
        Ok(())
    })?;
    let written = written.and_then(|()| out.finish(run.header()));
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
    let mut all: Vec<Column> = records.chain(references).collect();
    if header.content == Content::Torques {
        all.retain(|column| !column.of_reference && recording::is_in_torques(&column.field.path));
    }
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
