//! `torquectl config`: the configuration as the daemon understands it.

use crate::output::finish_or_refuse;
use clap::Subcommand;
use problem::Problems;
use robot_config::{Setting, Source};
use serde_json::json;
use std::process::ExitCode;
use terminal::TextTable;

const EXAMPLES: &str = "\
Examples:
  torquectl config show config/leg/robot.toml
  torquectl config show config/leg/robot.toml --defaults
  torquectl config show --json config/leg/robot.toml | jq '.settings[] | select(.source == \"default\")'

Keys are named as messages name them: table, key, and in parentheses the joint, drive or sensor.
docs/configuration.md explains each.

Exit codes:
  0  done
  2  the configuration or one of its files has a problem";

/// Show the configuration as the daemon understands it.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct ConfigArguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Every key with its value and where that comes from: a line of the file, or the default
    #[command(after_help = EXAMPLES)]
    Show(ShowArguments),
}

#[derive(clap::Args)]
struct ShowArguments {
    /// The robot's configuration
    #[arg(value_name = "CONFIG")]
    config: String,
    /// Only keys that the file lacks
    #[arg(long)]
    defaults: bool,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &ConfigArguments) -> ExitCode {
    let Command::Show(arguments) = &arguments.command;
    finish_or_refuse(show(arguments))
}

fn show(arguments: &ShowArguments) -> Result<String, Problems> {
    let read = |path: &str| terminal::read_text(path);
    let (robot, mut settings) = robot_config::load_with_settings(&arguments.config, &read)?;
    settings.retain(|setting| !arguments.defaults || setting.source == Source::Default);
    if arguments.json {
        let settings: Vec<_> = settings
            .iter()
            .map(|setting| object(&arguments.config, setting))
            .collect();
        let page = json!({ "robot": robot.parameters.name, "settings": settings });
        return Ok(format!("{page:#}\n"));
    }
    let mut rows = vec![["key", "value", "source"].map(str::to_owned).to_vec()];
    rows.extend(settings.iter().map(|setting| {
        let Setting { key, value, source } = setting;
        let source = match source {
            Source::Line(line) => format!("{}:{line}", arguments.config),
            Source::Default => "default".to_owned(),
        };
        vec![key.clone(), value.clone(), source]
    }));
    Ok(TextTable(rows).to_string())
}

fn object(config: &str, setting: &Setting) -> serde_json::Value {
    let Setting { key, value, source } = setting;
    match source {
        Source::Line(line) => json!({ "key": key, "value": value, "source": config, "line": line }),
        Source::Default => json!({ "key": key, "value": value, "source": "default" }),
    }
}
