//! `torquectl`: the operator's tool.

mod blackbox;
mod calibrate;
mod can;
mod cartesian;
mod check;
mod config;
mod contacts;
mod doctor;
mod dynamics;
mod estimate;
mod excite;
mod export;
mod fit;
mod identify;
mod import;
mod info;
mod learn;
mod margins;
mod metrics;
mod motion;
mod new;
mod operator;
mod output;
mod passive;
mod prove;
mod record;
mod recorded;
mod reference;
mod replay;
mod report;
mod requests;
mod rows;
mod spool;
mod stand;
mod state;
mod tare;
mod timing;
mod units;
mod view;
mod watch;
mod whole_body;
mod without_shared_memory;
mod words;

use clap::{CommandFactory, Parser, Subcommand};
use std::process::ExitCode;

/// Exit code where the daemon cannot be reached.
const NO_DAEMON: u8 = 1;
/// Exit code where a file or an argument is wrong; clap uses it too.
const BAD_INPUT: u8 = 2;

const AFTER_HELP: &str = "\
Examples:
  torquectl check config/leg/robot.toml
  torquectl doctor config/leg/robot.toml
  torquectl can scan
  torquectl new arm --urdf arm.urdf --scan can0
  torquectl margins config/leg/robot.toml --joint knee --plot knee.svg
  torquectl state
  torquectl enable
  torquectl prove config/leg/robot.toml
  torquectl move knee=60 --speed 20
  torquectl cartesian foot --stiffness 2000 --shift 0,0,-20
  torquectl passive knee --seconds 30
  torquectl stand --seconds 30
  torquectl watch --once
  torquectl timing --watch
  torquectl view --config config/leg/robot.toml
  torquectl tare --contacts in_the_air
  torquectl record -o run.mcap --seconds 10
  torquectl excite config/leg/excite.toml --record run.mcap
  torquectl replay run.mcap
  torquectl calibrate run.mcap -o calibrated
  torquectl identify drive run.mcap --joint knee
  torquectl learn run.mcap -o learned
  torquectl estimate --joint elbow.toml --log run.csv
  torquectl help check

Exit codes:
  0  done
  1  the daemon could not be reached, went away, or refused the request
  2  bad input: arguments, configuration, URDF, DBC, joint file or log";

/// Check, operate, watch, record and calibrate robots that run under torqued, and evaluate their models.
#[derive(Parser)]
#[command(name = "torquectl", version, after_help = AFTER_HELP)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Blackbox(blackbox::BlackboxArguments),
    Calibrate(calibrate::CalibrateArguments),
    Can(can::CanArguments),
    Cartesian(cartesian::CartesianArguments),
    Check(check::CheckArguments),
    Stand(stand::StandArguments),
    State(state::StateArguments),
    Enable(operator::EnableArguments),
    Disable(operator::DisableArguments),
    Stop(operator::StopArguments),
    Acknowledge(operator::AcknowledgeArguments),
    Config(config::ConfigArguments),
    Contacts(contacts::ContactsArguments),
    Doctor(doctor::DoctorArguments),
    Watch(watch::WatchArguments),
    Dynamics(dynamics::DynamicsArguments),
    Estimate(estimate::EstimateArguments),
    Excite(excite::ExciteArguments),
    Export(export::ExportArguments),
    Fit(fit::FitArguments),
    Identify(identify::IdentifyArguments),
    Info(info::InfoArguments),
    Learn(learn::LearnArguments),
    Record(record::RecordArguments),
    Replay(replay::ReplayArguments),
    Import(import::ImportArguments),
    Reference(reference::ReferenceArguments),
    Margins(margins::MarginsArguments),
    Metrics(metrics::MetricsArguments),
    Move(motion::MoveArguments),
    New(new::NewArguments),
    Passive(passive::PassiveArguments),
    Prove(prove::ProveArguments),
    Tare(tare::TareArguments),
    Timing(timing::TimingArguments),
    View(view::ViewArguments),
    WholeBody(whole_body::WholeBodyArguments),
}

fn main() -> ExitCode {
    if let Some(code) = terminal::pages(Arguments::command) {
        return code;
    }
    match Arguments::parse().command {
        Command::Blackbox(arguments) => blackbox::run(&arguments),
        Command::Calibrate(arguments) => calibrate::run(&arguments),
        Command::Can(arguments) => can::run(&arguments),
        Command::Cartesian(arguments) => cartesian::run(&arguments),
        Command::Check(arguments) => check::run(&arguments),
        Command::Stand(arguments) => stand::run(&arguments),
        Command::State(arguments) => state::run(&arguments),
        Command::Enable(arguments) => operator::enable(&arguments),
        Command::Disable(arguments) => operator::disable(&arguments),
        Command::Stop(arguments) => operator::stop(&arguments),
        Command::Acknowledge(arguments) => operator::acknowledge(&arguments),
        Command::Watch(arguments) => watch::run(&arguments),
        Command::Dynamics(arguments) => dynamics::run(&arguments),
        Command::Estimate(arguments) => estimate::run(&arguments),
        Command::Excite(arguments) => excite::run(&arguments),
        Command::Config(arguments) => config::run(&arguments),
        Command::Contacts(arguments) => contacts::run(&arguments),
        Command::Doctor(arguments) => doctor::run(&arguments),
        Command::Export(arguments) => export::run(&arguments),
        Command::Fit(arguments) => fit::run(&arguments),
        Command::Identify(arguments) => identify::run(&arguments),
        Command::Info(arguments) => info::run(&arguments),
        Command::Learn(arguments) => learn::run(&arguments),
        Command::Record(arguments) => record::run(&arguments),
        Command::Replay(arguments) => replay::run(&arguments),
        Command::Import(arguments) => import::run(&arguments),
        Command::Reference(arguments) => reference::run(&arguments),
        Command::Margins(arguments) => margins::run(&arguments),
        Command::Metrics(arguments) => metrics::run(&arguments),
        Command::Move(arguments) => motion::run(&arguments),
        Command::New(arguments) => new::run(&arguments),
        Command::Passive(arguments) => passive::run(&arguments),
        Command::Prove(arguments) => prove::run(&arguments),
        Command::Tare(arguments) => tare::run(&arguments),
        Command::Timing(arguments) => timing::run(&arguments),
        Command::View(arguments) => view::run(&arguments),
        Command::WholeBody(arguments) => whole_body::run(&arguments),
    }
}
