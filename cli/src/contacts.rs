//! `torquectl contacts`: the contact set of a running robot.

use crate::requests::{Failure, PATIENCE, check_contacts, connect, contact_names, end};
use serde_json::json;
use std::process::ExitCode;
use torqued_client::{Client, Error};

/// The name that leaves the choice to the rule.
const AUTOMATIC: &str = "automatic";
/// Records until one reports the choice, at most; the daemon has it already.
const LOOKS: usize = 300;

const HELP: &str = "\
Contact sets are the tables [[contacts]] of robot.toml. Torques and contact wrenches of the old set
are blended into those of the new one over [whole_body] blend_ms.

Examples:
  torquectl contacts                  list the sets; * marks the present one
  torquectl contacts on_left_foot
  torquectl contacts automatic        let the rule [whole_body.load] choose
  torquectl contacts --json

Exit codes:
  0  done
  1  torqued refused and gave a reason, or could not be reached
  2  bad input: arguments, or a contact set that the robot does not have";

/// Show or choose the contact set of a running robot.
#[derive(clap::Args)]
#[command(after_help = HELP)]
pub(crate) struct ContactsArguments {
    /// The contact set to use, or `automatic`; without it the sets are listed
    #[arg(value_name = "NAME|automatic")]
    name: Option<String>,
    /// The robot's name; optional if only one robot runs
    #[arg(long, value_name = "NAME")]
    robot: Option<String>,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &ContactsArguments) -> ExitCode {
    end(contacts(arguments))
}

fn contacts(arguments: &ContactsArguments) -> Result<String, Failure> {
    let mut client = connect(arguments.robot.as_ref())?;
    match arguments.name.as_deref() {
        Some(AUTOMATIC) => _ = client.automatic_contact_set()?,
        Some(name) => {
            check_contacts(&client, name, ", automatic")?;
            client.choose_contact_set(name)?;
        }
        None => {}
    }
    Ok(show(&mut client, arguments)?)
}

/// The list of sets, with a mark at the present one. After a choice it waits for a record that
/// reports the choice.
fn show(client: &mut Client, arguments: &ContactsArguments) -> Result<String, Error> {
    let (mut holds, mut automatic) = (0, false);
    let names: Vec<String> = contact_names(client)
        .iter()
        .map(|n| (*n).to_owned())
        .collect();
    for _ in 0..LOOKS {
        let record = client.next_record(PATIENCE)?;
        holds = record.cycle.estimated.contact_set as usize;
        automatic = record.cycle.estimated.contact_set_automatic == 1;
        match arguments.name.as_deref() {
            Some(AUTOMATIC) if automatic => break,
            Some(name) if !automatic && names.get(holds).is_some_and(|n| n == name) => break,
            None => break,
            Some(_) => {}
        }
    }
    let chosen = names.get(holds);
    if arguments.json {
        let shown = json!({
            "robot": client.robot(),
            "contacts": chosen,
            "automatic": automatic,
            "sets": names,
        });
        return Ok(format!("{shown}\n"));
    }
    let mark = |name: &String| if Some(name) == chosen { "*" } else { " " };
    let lines = names.iter().map(|name| format!("{} {name}\n", mark(name)));
    let chosen_by = if automatic {
        "chosen by the automatic rule\n"
    } else {
        "chosen by a client or the configuration\n"
    };
    Ok(lines.collect::<String>() + chosen_by)
}
