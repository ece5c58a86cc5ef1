//! `torquectl fit`: parameters of a joint's estimators from recorded logs.

use crate::BAD_INPUT;
use crate::estimate::{open_log, read_joint};
use clap::{Args, Subcommand};
use identification::all;
use identification::log::LogRow;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Fit the estimators of a joint to recorded logs
#[derive(Args)]
pub(crate) struct FitArguments {
    #[command(subcommand)]
    what: What,
}

#[derive(Subcommand)]
enum What {
    All(AllArguments),
}

/// Fit every estimator: kinematic error from an unloaded turn, the rest from loaded motion
#[derive(Args)]
struct AllArguments {
    /// The joint (TOML): its table [joint] is enough
    #[arg(long)]
    joint: PathBuf,
    /// Log of one unloaded output turn each way (CSV: t,theta,q,i)
    #[arg(long)]
    no_load: PathBuf,
    /// Log of loaded motion and rest (CSV: t,theta,q,i,tau_sensor)
    #[arg(long)]
    training: PathBuf,
    /// Where the fitted joint is written (TOML)
    #[arg(short, long)]
    out: PathBuf,
}

pub(crate) fn run(arguments: &FitArguments) -> ExitCode {
    let What::All(arguments) = &arguments.what;
    match fit_all(arguments) {
        Ok(report) => {
            println!("{report}");
            ExitCode::SUCCESS
        }
        Err(message) => {
            eprintln!("torquectl fit: {message}");
            ExitCode::from(BAD_INPUT)
        }
    }
}

fn fit_all(arguments: &AllArguments) -> Result<String, String> {
    let joint = read_joint(&arguments.joint)?;
    let turn = rows(&arguments.no_load, false)?;
    let train = rows(&arguments.training, true)?;
    let fitted = all::fit(&joint, &turn, &train).map_err(|e| e.to_string())?;
    let text = fitted.joint.to_toml().map_err(|e| e.to_string())?;
    let out = arguments.out.display();
    std::fs::write(&arguments.out, text).map_err(|e| format!("{out}: {e}"))?;
    Ok(format!("{}\nwritten to {out}", fitted.report.join("\n")))
}

fn rows(path: &Path, torque: bool) -> Result<Vec<LogRow>, String> {
    let log = open_log(path)?;
    if torque && !log.has_torque() {
        let reason = "column `tau_sensor` is missing; needed for training".to_owned();
        return Err(log.error(reason).to_string());
    }
    log.rows().map_err(|e| e.to_string())
}
