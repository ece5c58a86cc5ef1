//! The page of results.

use crate::Arguments;
use crate::mujoco::Mujoco;
use crate::own::Own;
use crate::stand::{BEFORE_S, Stood, TO_PUSH_S, World, humanoid, stand};
use robot_config::Robot;
use robot_state::Mode;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use test_support::ResultsPage;

const WORLDS: [&str; 2] = ["own", "mujoco"];
const SIDES: [(&str, [f64; 2]); 4] = [
    ("behind", [1.0, 0.0]),
    ("front", [-1.0, 0.0]),
    ("right", [0.0, 1.0]),
    ("left", [0.0, -1.0]),
];
const MODES: [Mode; 2] = [Mode::InverseDynamics, Mode::Stand];
const FORCES: [f64; 2] = [30.0, 60.0];
/// Time from the push to the end, s: the last second of it is judged, five seconds after the push.
const AFTER_S: f64 = 6.3;
/// Share of the long time on the own plant for which the robot stands in MuJoCo.
const SHARE_IN_MUJOCO: f64 = 0.2;

fn world(name: &str, robot: &Robot, seed: u64, force: [f64; 2]) -> Result<Box<dyn World>, String> {
    let start = BEFORE_S + TO_PUSH_S;
    Ok(match name {
        "own" => Box::new(Own::new(robot, seed, force, start)?),
        "mujoco" => Box::new(Mujoco::new(robot, seed, force, start)?),
        _ => return Err(format!("no world {name}: own or mujoco")),
    })
}

/// Runs all and writes the page.
///
/// # Errors
/// Files, or a world that ends.
pub(crate) fn write(arguments: &Arguments) -> Result<(), String> {
    let robot = humanoid()?;
    let worlds: Vec<&str> = match &arguments.world {
        Some(one) => vec![one.as_str()],
        None => WORLDS.to_vec(),
    };
    let asked = arguments.mode.as_deref();
    let modes = MODES.into_iter();
    let modes: Vec<Mode> =
        (modes.filter(|mode| asked.is_none_or(|asked| asked == mode.name()))).collect();
    if modes.is_empty() {
        return Err(format!(
            "no mode {}: inverse_dynamics or stand",
            asked.unwrap_or_default()
        ));
    }
    let asked = (&robot, arguments, worlds.as_slice(), modes.as_slice());
    let mut text = HEAD
        .replace("PUSHES", &arguments.pushes.to_string())
        .replace("LONG", &arguments.long.to_string())
        .replace("DRAWS", &arguments.draws.to_string())
        .replace("SECONDS", &arguments.seconds.to_string())
        .replace("STEPPERS", &arguments.steppers.to_string())
        .replace("STEPS", &arguments.steps.to_string());
    pushed(asked, &mut text)?;
    left_alone(asked, &mut text)?;
    stepping(asked, &mut text)?;
    ResultsPage::new(&text)?.write(&arguments.out)
}

/// The robot, what is asked for, worlds and modes.
type Asked<'a> = (&'a Robot, &'a Arguments, &'a [&'a str], &'a [Mode]);

/// A run: joints, mode, world, force and time.
struct Job<'a> {
    push: String,
    world: &'a str,
    mode: Mode,
    seed: u64,
    force: [f64; 2],
    steps: bool,
    seconds: f64,
}

/// All runs by so many threads, in their order.
fn run_all(robot: &Robot, jobs: &[Job<'_>], threads: usize) -> Result<Vec<Stood>, String> {
    let next = AtomicUsize::new(0);
    let done = Mutex::new(Vec::new());
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                while let Some((k, job)) = {
                    let k = next.fetch_add(1, Ordering::Relaxed);
                    jobs.get(k).map(|job| (k, job))
                } {
                    let stood =
                        world(job.world, robot, job.seed, job.force).and_then(|mut world| {
                            stand(robot, &mut *world, job.mode, job.steps, job.seconds)
                        });
                    let (name, mode) = (job.world, job.mode.name());
                    let (push, seconds) = (&job.push, job.seconds);
                    println!("{push} {name} {mode} {}, {seconds} s: {stood:?}", job.seed);
                    if let Ok(mut done) = done.lock() {
                        done.push((k, stood));
                    }
                }
            });
        }
    });
    let mut done = done.into_inner().unwrap_or_default();
    done.sort_by_key(|(k, _)| *k);
    done.into_iter().map(|(_, stood)| stood).collect()
}

/// A row for each push: the first of the least force, then of the greatest one.
fn pushed((robot, arguments, worlds, modes): Asked<'_>, text: &mut String) -> Result<(), String> {
    let of_sides = SIDES.len() as u64;
    let mut jobs = Vec::new();
    for k in 0..arguments.pushes {
        let force = FORCES[usize::from(k >= of_sides)];
        let (side, [x, y]) = SIDES[(k % of_sides) as usize];
        let push = format!("{force:.0} N from {side}");
        if (arguments.push.as_ref()).is_some_and(|only| !push.contains(only)) {
            continue;
        }
        let few = k < 2 * of_sides;
        let many = |(world, mode): &(&str, Mode)| *world == "own" && *mode == Mode::Stand;
        let each = each(worlds, modes).filter(|each| few || many(each));
        jobs.extend(each.map(|(world, mode)| Job {
            push: push.clone(),
            world,
            mode,
            seed: k + 1,
            force: [force * x, force * y],
            steps: false,
            seconds: TO_PUSH_S + AFTER_S,
        }));
    }
    for (job, stood) in jobs.iter().zip(run_all(robot, &jobs, arguments.threads)?) {
        *text += &row(&job.push, (job.world, job.mode), &stood);
    }
    Ok(())
}

/// A row for the draws of each mode in each world, and for one that stands for long.
fn left_alone(
    (robot, arguments, worlds, modes): Asked<'_>,
    text: &mut String,
) -> Result<(), String> {
    *text += QUIET;
    let mut rows = Vec::new();
    let mut jobs = Vec::new();
    for (world, mode) in each(worlds, modes) {
        let mut runs = vec![(arguments.draws, arguments.seconds)];
        let share = if world == "mujoco" {
            SHARE_IN_MUJOCO
        } else {
            1.0
        };
        if mode == Mode::Stand && arguments.long > 0.0 {
            runs.push((1, share * arguments.long));
        }
        for (draws, seconds) in runs.into_iter().filter(|(draws, _)| *draws > 0) {
            let first = jobs.len();
            jobs.extend((1..=draws).map(|seed| Job {
                push: String::new(),
                world,
                mode,
                seed,
                force: [0.0; 2],
                steps: false,
                seconds,
            }));
            rows.push(((world, mode), seconds, first..jobs.len()));
        }
    }
    let all = run_all(robot, &jobs, arguments.threads)?;
    for (of, seconds, its) in rows {
        *text += &quiet(of, seconds, all.get(its).unwrap_or_default());
    }
    Ok(())
}

/// A row for each robot that steps in place by mode stand.
fn stepping((robot, arguments, worlds, modes): Asked<'_>, text: &mut String) -> Result<(), String> {
    if arguments.steps <= 0.0 || !modes.contains(&Mode::Stand) {
        return Ok(());
    }
    *text += STEPPING;
    let each = worlds
        .iter()
        .flat_map(|world| (1..=arguments.steppers).map(move |seed| (*world, seed)));
    let jobs: Vec<Job<'_>> = (each.map(|(world, seed)| Job {
        push: "steps".to_owned(),
        world,
        mode: Mode::Stand,
        seed,
        force: [0.0; 2],
        steps: true,
        seconds: arguments.steps,
    }))
    .collect();
    for (job, stood) in jobs.iter().zip(run_all(robot, &jobs, arguments.threads)?) {
        let verdict = verdict(&stood);
        let (steps, fastest) = (stood.steps, stood.fastest);
        *text += &format!(
            "| {} | {} | {} | {steps} | {verdict} | {fastest:.2} | {:.2} | {:.2} |\n",
            job.world, job.seed, job.seconds, stood.turned, stood.drift
        );
    }
    Ok(())
}

/// Each mode in each world.
fn each<'a>(worlds: &'a [&'a str], modes: &'a [Mode]) -> impl Iterator<Item = (&'a str, Mode)> {
    let worlds = worlds.iter();
    worlds.flat_map(|world| modes.iter().map(|mode| (*world, *mode)))
}

/// A mode as the documents call it.
fn called(mode: Mode) -> String {
    mode.name().replace('_', " ")
}

fn verdict(stood: &Stood) -> String {
    match (stood.fallen, &stood.fault) {
        (false, None) if stood.ended => "**ends**".to_owned(),
        (false, None) => "stands".to_owned(),
        (true, None) => "**falls**".to_owned(),
        (fallen, Some((event, joint))) => {
            let falls = if fallen { ", falls" } else { "" };
            format!("**{} {joint}{falls}**", event.number())
        }
    }
}

fn row(push: &str, (world, mode): (&str, Mode), stood: &Stood) -> String {
    format!(
        "| {push} | {world} | {} | {} | {:.2} | {:.3} | {:.3} |\n",
        called(mode),
        verdict(stood),
        stood.fastest,
        stood.sway,
        stood.drift
    )
}

fn quiet((world, mode): (&str, Mode), seconds: f64, all: &[Stood]) -> String {
    let of = |value: &dyn Fn(&Stood) -> f64| {
        let mut values: Vec<f64> = all.iter().map(value).collect();
        values.sort_by(f64::total_cmp);
        let at = |k: usize| values.get(k).copied().unwrap_or(f64::NAN);
        (at(values.len() / 2), at(values.len().saturating_sub(1)))
    };
    let stand = all.iter().filter(|stood| stood.stands()).count();
    let (_, fastest) = of(&|stood| stood.fastest);
    let ((sway, most_sway), (drift, most_drift)) = (of(&|s| s.sway), of(&|s| s.drift));
    let mut events: Vec<String> = Vec::new();
    for number in all.iter().flat_map(|stood| &stood.events) {
        let name = format!("{}", number.0.number());
        if !events.contains(&name) {
            events.push(name);
        }
    }
    let events = if events.is_empty() {
        "none".to_owned()
    } else {
        events.join(", ")
    };
    format!(
        "| {world} | {} | {seconds} | {stand} of {} | {fastest:.3} | {sway:.3}, {most_sway:.3} | {drift:.3}, {most_drift:.3} | {events} |\n",
        called(mode),
        all.len()
    )
}

const HEAD: &str = "# A humanoid that stands

Written by `cargo run --release -p standing-bench -- --pushes PUSHES --long LONG --draws DRAWS --seconds SECONDS --steps STEPS --steppers STEPPERS`. The shipped humanoid in modes inverse dynamics and [stand](../modes.md#mode-stand), with references of the pose alone. Two worlds in front of the same loop:

- **own**: `crates/plant`, each kind of drive with gains ±10 %, friction and presliding times 0.5 to 2.
- **mujoco**: [rt-tests/second-world/world.py](../../rt-tests/second-world/world.py). Rigid bodies and contacts are MuJoCo's; it shares no code with the plant. Each joint has a linear gear ±7 % with Bouc-Wen hysteresis, rigid friction times 0.5 to 2 that grows with the load, a rotor ±10 %, a P-P cascade ±10 % at 4 kHz, a torque constant ±2 %, an offset of its current. A tenth of the kinematic error is left.

## Pushes

At the chest for 0.3 s; each push with other joints. The base's largest angular velocity; its sway within the sixth second after the push; its angle at the end from where it was.

<!-- rows: standing-pushes.csv, 5 greatest of angle, degrees -->

| push | world | mode | | rad/s | sway, degrees | angle, degrees |
| --- | --- | --- | --- | --- | --- | --- |
";

const QUIET: &str = "
## Without a push

Each time with other joints; sway over the last second, and the angle of the base from where it began.

| world | mode | s | stand | largest angular velocity, rad/s | sway, degrees: median, worst | drift, degrees: median, worst | events |
| --- | --- | --- | --- | --- | --- | --- | --- |
";

const STEPPING: &str = "
## Stepping in place

Mode stand; each foot in turn is lifted by 30 mm and put down again. The base's angle from where it began: greatest, and at the end.

| world | joints | s | steps | | rad/s | greatest angle, degrees | angle at the end, degrees |
| --- | --- | --- | --- | --- | --- | --- | --- |
";
