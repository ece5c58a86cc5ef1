//! Measures how soon a reference is seen in a record: from its sending to the first record of a cycle that followed it.
//! The robot only holds. Prints one line of JSON.
//!
//!     cargo run --release -p torqued-client --example 04_round_trip -- leg 10

use std::error::Error;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use torqued_client::{Client, Commander, Location};

/// A reference that no cycle has followed by then came after its lease had ended: this program was kept from running.
const UNANSWERED: Duration = Duration::from_millis(100);

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("{e}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let robot = match arguments.next() {
        Some(robot) => robot,
        None => Location::find()?.only_robot()?,
    };
    let seconds: f64 = arguments.next().map_or(Ok(10.0), |text| text.parse())?;
    let mut client = Client::connect(&robot)?;
    let mut commander = Commander::connect(&mut client)?;
    client.latest()?;
    let begin = Instant::now();
    let mut trips = Vec::new();
    let (mut records, mut lost, mut unanswered) = (0_u64, 0, 0);
    while begin.elapsed().as_secs_f64() < seconds {
        let sent = Instant::now();
        commander.send(|_| ())?;
        let sequence = commander.reference().sequence;
        loop {
            let record = client.next_record(Duration::from_secs(1))?;
            (records, lost) = (records + 1, lost + record.lost);
            if record.cycle.commander.sequence >= sequence {
                trips.push(sent.elapsed().as_secs_f64() * 1e3);
                break;
            }
            if sent.elapsed() > UNANSWERED {
                unanswered += 1;
                break;
            }
        }
    }
    let took = begin.elapsed().as_secs_f64();
    trips.sort_unstable_by(f64::total_cmp);
    let at = |share: f64| trips[((trips.len() - 1) as f64 * share) as usize];
    println!(
        "{{\"records_per_s\": {:.1}, \"lost\": {lost}, \"unanswered\": {unanswered}, \"p50_ms\": {:.3}, \
         \"p99_ms\": {:.3}, \"max_ms\": {:.3}}}",
        records as f64 / took,
        at(0.5),
        at(0.99),
        at(1.0)
    );
    commander.close()?;
    Ok(())
}
