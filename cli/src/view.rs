//! `torquectl view`: a running robot or a recorded run as a page in the browser.
//!
//! A thread reads every record and keeps what the page shows of the last seconds ([`hub`]); the page's
//! requests are served from there ([`server`]). The daemon sees one more client that reads.

mod control;
mod foxglove;
mod hub;
mod live;
mod played;
mod row;
mod scene;
mod server;
mod status;

use crate::motion::catch_signals;
use crate::output::finish_or_refuse;
use crate::requests::{Failure, connect, end};
use hub::Hub;
use problem::Problem;
use scene::Scene;
use server::{Pages, Server};
use std::io::Read;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

const HELP: &str = "\
The page is served on this machine alone (but with --listen), under an address that has a random word in
it; it loads nothing from elsewhere. It shows state, next step, events, torques of all joints, one joint in full,
the robot with its contact wrenches (with --config), and times of the loop. Keys: docs/view.md.

With --foxglove, Foxglove and PlotJuggler get joint states, wrenches and IMU of every record, live.

With --control the page has buttons for stop, enable, acknowledge, disable and move, which are refused
as on the command line; then it is served on this machine alone. Stop on the page is no emergency stop.

Examples:
  torquectl view
  torquectl view --robot leg --config config/leg/robot.toml
  torquectl view --config config/leg/robot.toml --control
  torquectl view run.mcap
  torquectl view --foxglove                  in Foxglove: Open connection, ws://127.0.0.1:8765
  torquectl view --listen 192.168.1.2:8731    for a tablet beside the robot, in a network that you trust

Exit codes:
  0  ended by Ctrl-C
  1  no torqued answered within 2 s
  2  bad input: arguments, configuration, recorded run";

/// Show a running robot, or a recorded run, as a page in the browser.
#[derive(clap::Args)]
#[command(after_help = HELP)]
pub(crate) struct ViewArguments {
    /// A recorded run; without it, the running robot
    #[arg(value_name = "RUN.mcap", conflicts_with_all = ["robot", "config", "control"])]
    run: Option<PathBuf>,
    /// The robot's name; optional if only one robot runs
    #[arg(long, value_name = "NAME")]
    robot: Option<String>,
    /// The robot's configuration, to draw the robot from its URDF
    #[arg(long, value_name = "CONFIG")]
    config: Option<PathBuf>,
    /// Let the page enable, stop, acknowledge, disable and move
    #[arg(long)]
    control: bool,
    /// Serve the messages of recordings live to Foxglove and PlotJuggler too, by Foxglove's WebSocket protocol
    #[arg(long, value_name = "ADDRESS:PORT", num_args = 0..=1, default_missing_value = foxglove::ADDRESS,
          conflicts_with = "run")]
    foxglove: Option<SocketAddr>,
    /// Address and port to serve on; port 0 is any that is free
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:0")]
    listen: SocketAddr,
}

pub(crate) fn run(arguments: &ViewArguments) -> ExitCode {
    match &arguments.run {
        Some(run) => finish_or_refuse(played(run, arguments)),
        None => end(live(arguments)),
    }
}

fn played(run: &std::path::Path, arguments: &ViewArguments) -> Result<String, Problem> {
    let hub = Arc::new(played::read(run)?);
    serve(arguments, &hub, None)
}

fn live(arguments: &ViewArguments) -> Result<String, Failure> {
    if arguments.control && !arguments.listen.ip().is_loopback() {
        let what = format!(
            "--listen {}: the robot is not controlled through a network, which anyone on it could read",
            arguments.listen
        );
        let allowed =
            "--control with 127.0.0.1; from another machine through `ssh -L 8731:127.0.0.1:8731`";
        return Err(Failure::Argument(Problem::new(what, allowed)));
    }
    let drawn = arguments.config.as_deref().map(scene::drawn_from_files);
    let drawn = drawn.transpose().map_err(Failure::Argument)?;
    let client = connect(arguments.robot.as_ref())?;
    let robot = client.robot().to_owned();
    if let Some(address) = arguments.foxglove {
        let own = connect(Some(&robot))?;
        let address = foxglove::serve(address, own).map_err(Failure::Argument)?;
        terminal::print(&format!("Foxglove: ws://{address}\n"))
            .map_err(|e| Failure::Argument(Problem::new(e.to_string(), "")))?;
    }
    let scene = Scene::of_robot(client.description(), drawn, arguments.control);
    let hub = Arc::new(Hub::live(scene));
    let reading = Arc::clone(&hub);
    let reader = std::thread::Builder::new()
        .name("records".to_owned())
        .spawn(move || live::read(client, &reading));
    reader.map_err(|e| Failure::Argument(Problem::new(format!("no thread: {e}"), "")))?;
    let control = arguments.control.then_some(robot);
    serve(arguments, &hub, control).map_err(Failure::Argument)
}

/// A word that nobody else's program guesses.
fn random_word() -> Result<String, Problem> {
    let mut bytes = [0; 16];
    let read = std::fs::File::open("/dev/urandom").and_then(|mut file| file.read_exact(&mut bytes));
    read.map_err(|e| Problem::new(format!("no random numbers: {e}"), "").at("/dev/urandom", 0))?;
    Ok(format!("{:032x}", u128::from_ne_bytes(bytes)))
}

/// Serves until the user ends it.
fn serve(
    arguments: &ViewArguments,
    hub: &Arc<Hub>,
    control: Option<String>,
) -> Result<String, Problem> {
    let stop = catch_signals()?;
    let server = Server::bind(arguments.listen)?;
    let pages = Pages {
        token: random_word()?,
        loopback: server.address.ip().is_loopback(),
        hub: Arc::clone(hub),
        control: control.map(control::Control::new),
    };
    terminal::print(&format!(
        "http://{}/{}/\nCtrl-C ends it\n",
        server.address, pages.token
    ))
    .map_err(|e| Problem::new(format!("cannot print: {e}"), ""))?;
    server.run(pages, &stop);
    hub.close();
    Ok(String::new())
}
