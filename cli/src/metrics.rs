//! `torquectl metrics`: a running robot's figures, in the text format of Prometheus.

use crate::NO_DAEMON;
use crate::timing::times;
use serde_json::Value;
use std::fmt::Write;
use std::net::SocketAddr;
use std::process::ExitCode;
use std::time::Duration;
use tiny_http::{Header, Method, Response, Server};
use torqued_client::robot_state::{Event, RobotState, SharedRecord};
use torqued_client::{Client, Location};

/// Longest wait for a record while somebody waits for the figures.
const WAIT: Duration = Duration::from_millis(200);
/// The type that Prometheus asks for.
const TYPE: &str = "text/plain; version=0.0.4; charset=utf-8";

const EXAMPLES: &str = "\
Examples:
  torquectl metrics --listen 127.0.0.1:9464
  torquectl metrics --once | grep torqued_late_cycles_total
  curl http://127.0.0.1:9464/metrics

A client as any other: it may come and go, and the loop does not notice. torqued_up is 0 while no daemon runs.

Exit codes:
  0  done
  1  the address cannot be listened at";

/// Serve a running robot's figures to Prometheus: cycles, times, late cycles by cause, events, state, fault.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct MetricsArguments {
    /// The robot's name; optional if only one robot runs
    #[arg(long, value_name = "NAME")]
    robot: Option<String>,
    /// Address and port to serve at
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:9464")]
    listen: SocketAddr,
    /// Print the figures once, and serve nothing
    #[arg(long, conflicts_with = "listen")]
    once: bool,
}

pub(crate) fn run(arguments: &MetricsArguments) -> ExitCode {
    let mut source = Source {
        robot: arguments.robot.clone(),
        client: None,
    };
    if arguments.once {
        return crate::output::finish(&source.text());
    }
    let server = match Server::http(arguments.listen) {
        Ok(server) => server,
        Err(why) => {
            eprintln!(
                "--listen {}: {why}; allowed: an address of this machine and a free port",
                arguments.listen
            );
            return ExitCode::from(NO_DAEMON);
        }
    };
    eprintln!("http://{}/metrics", server.server_addr());
    for request in server.incoming_requests() {
        let answer = if *request.method() == Method::Get && request.url() == "/metrics" {
            let header = Header::from_bytes("Content-Type", TYPE);
            let response = Response::from_string(source.text());
            match header {
                Ok(header) => response.with_header(header),
                Err(()) => response,
            }
        } else {
            Response::from_string("GET /metrics\n").with_status_code(404)
        };
        // Whoever asked may have gone.
        let _ = request.respond(answer);
    }
    ExitCode::SUCCESS
}

/// Where the figures come from; reconnects after a restart of the daemon.
struct Source {
    robot: Option<String>,
    client: Option<Client>,
}

impl Source {
    fn text(&mut self) -> String {
        let mut text = Text::default();
        let times = times(self.robot.as_deref()).ok();
        let record = times
            .as_ref()
            .and_then(|times| self.record(times["robot"].as_str()?));
        let up = u8::from(record.is_some());
        text.family(
            "torqued_up",
            "gauge",
            "1 while the daemon publishes records.",
        );
        text.sample("torqued_up", &[], f64::from(up));
        if let Some(times) = &times {
            text.times(times);
        }
        if let Some(record) = &record {
            text.record(record);
        }
        text.0
    }

    /// The newest record.
    fn record(&mut self, robot: &str) -> Option<Box<SharedRecord>> {
        if self.client.is_none() {
            let location = Location::find().ok()?;
            self.client = Client::connect_at(&location, robot, WAIT).ok();
        }
        let record = self
            .client
            .as_mut()?
            .next_record(WAIT)
            .ok()
            .map(|record| Box::new(*record));
        if record.is_none() {
            self.client = None;
        }
        record
    }
}

/// Text in Prometheus' format.
#[derive(Default)]
struct Text(String);

impl Text {
    fn family(&mut self, name: &str, kind: &str, help: &str) {
        let _ = writeln!(self.0, "# HELP {name} {help}\n# TYPE {name} {kind}");
    }

    fn sample(&mut self, name: &str, labels: &[(&str, &str)], value: f64) {
        let quoted = |text: &str| {
            text.replace('\\', "\\\\")
                .replace('"', "\\\"")
                .replace('\n', "\\n")
        };
        let labels: Vec<String> = labels
            .iter()
            .map(|(key, value)| format!("{key}=\"{}\"", quoted(value)))
            .collect();
        let labels = if labels.is_empty() {
            String::new()
        } else {
            format!("{{{}}}", labels.join(","))
        };
        let _ = writeln!(self.0, "{name}{labels} {value}");
    }

    fn times(&mut self, times: &Value) {
        let count = |key: &str| times[key].as_f64().unwrap_or(0.0);
        self.family("torqued_cycles_total", "counter", "Cycles run.");
        self.sample("torqued_cycles_total", &[], count("cycles"));
        self.family(
            "torqued_skipped_cycles_total",
            "counter",
            "Cycles left out because an earlier one was too late.",
        );
        self.sample("torqued_skipped_cycles_total", &[], count("skipped_cycles"));
        let name = "torqued_late_cycles_total";
        self.family(
            name,
            "counter",
            "Cycles that ended after the next should have begun, by cause.",
        );
        for (cause, count) in times["late_by_cause"].as_object().into_iter().flatten() {
            self.sample(name, &[("cause", cause)], count.as_f64().unwrap_or(0.0));
        }
        let name = "torqued_phase_seconds";
        self.family(
            name,
            "summary",
            "Time of a cycle's phases since the daemon's start.",
        );
        for phase in times["phases"].as_array().into_iter().flatten() {
            let of = phase["name"].as_str().unwrap_or_default();
            for (quantile, key) in [
                ("0.5", "p50_us"),
                ("0.99", "p99_us"),
                ("0.999", "p999_us"),
                ("1", "max_us"),
            ] {
                let seconds = 1e-6 * phase[key].as_f64().unwrap_or(0.0);
                self.sample(name, &[("phase", of), ("quantile", quantile)], seconds);
            }
        }
    }

    fn record(&mut self, record: &SharedRecord) {
        let SharedRecord { cycle, timing } = record;
        self.family(
            "torqued_frames_received_total",
            "counter",
            "Frames received.",
        );
        self.sample(
            "torqued_frames_received_total",
            &[],
            timing.frames_received as f64,
        );
        self.family("torqued_frames_sent_total", "counter", "Frames sent.");
        self.sample("torqued_frames_sent_total", &[], timing.frames_sent as f64);
        let name = "torqued_state";
        self.family(name, "gauge", "1 for the robot's state.");
        let state = RobotState::from_number(cycle.state).map_or("unknown", RobotState::name);
        self.sample(name, &[("state", state)], 1.0);
        self.family(
            "torqued_fault",
            "gauge",
            "Number of the latched fault, 0 without one.",
        );
        self.sample("torqued_fault", &[], f64::from(cycle.fault));
        let name = "torqued_events_total";
        self.family(
            name,
            "counter",
            "Occurrences of each numbered event since start.",
        );
        for (event, &count) in Event::ALL.iter().zip(&cycle.events) {
            if count > 0 {
                let number = event.number().to_string();
                self.sample(
                    name,
                    &[("event", event.name()), ("number", &number)],
                    count as f64,
                );
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Text;

    #[test]
    fn labels_are_quoted() {
        let mut text = Text::default();
        text.sample(
            "torqued_late_cycles_total",
            &[("cause", "bus \"a\"\\")],
            3.0,
        );
        assert_eq!(
            text.0,
            "torqued_late_cycles_total{cause=\"bus \\\"a\\\"\\\\\"} 3\n"
        );
    }
}
