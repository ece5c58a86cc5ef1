//! Every estimator in every scenario (scratch)
use estimators::joint::JointTorqueEstimator;
use identification::all;
use identification::evaluate::Score;
use joint_torque_bench::joint::BenchJoint;
use joint_torque_bench::scenario;
use std::time::Instant;

fn main() {
    let args: Vec<String> = std::env::args().collect();
    let name = args.get(1).map_or("z", String::as_str);
    let seed: u64 = args.get(2).map_or(0, |s| s.parse().unwrap());
    let mut joint = BenchJoint::named(name).unwrap();
    if seed > 0 {
        joint = joint.redrawn(seed);
    }
    let rows = |s: &scenario::Scenario| {
        joint
            .run(s)
            .into_iter()
            .map(|(row, _)| row)
            .collect::<Vec<_>>()
    };
    let start = Instant::now();
    let turn = rows(&scenario::turn(&joint));
    let train = rows(&scenario::train(&joint));
    eprintln!("simulated {:?}", start.elapsed());
    let start = Instant::now();
    let fitted = all::fit(&joint.file, &turn, &train, &mut |_, _| ()).unwrap();
    eprintln!("fitted {:?}", start.elapsed());
    for line in &fitted.report {
        println!("{line}");
    }
    if let Some(dir) = args.get(3) {
        std::fs::create_dir_all(dir).unwrap();
        let write = |name: &str, rows: &[identification::log::LogRow]| {
            let mut text = String::from("t,theta,q,i,tau_sensor\n");
            for r in rows {
                text += &format!(
                    "{},{},{},{},{}\n",
                    r.t, r.theta, r.q, r.current, r.tau_sensor
                );
            }
            std::fs::write(format!("{dir}/{name}.csv"), text).unwrap();
        };
        write("turn", &turn);
        write("train", &train);
        std::fs::write(
            format!("{dir}/fitted.toml"),
            fitted.joint.to_toml().unwrap(),
        )
        .unwrap();
        for s in scenario::experiments(&joint)
            .into_iter()
            .chain(scenario::u_experiments(&joint))
        {
            write(&s.name.replace(' ', "-"), &rows(&s));
        }
    }
    let mut set = fitted.joint.estimators().unwrap();
    let mut names: Vec<String> = set.names().to_vec();
    names.push("fused".into());
    println!(
        "{:14} {}",
        "",
        names.iter().map(|n| format!("{n:>16}")).collect::<String>()
    );
    for s in scenario::experiments(&joint)
        .into_iter()
        .chain(scenario::u_experiments(&joint))
    {
        let run = joint.run(&s);
        set.reset();
        let mut front = fitted.joint.front_end().unwrap();
        let mut scores = vec![Score::new(1e-3); names.len()];
        for (row, tau) in &run {
            let sample = front.update(row.theta, row.q, row.current);
            let fused = set.update(&sample);
            if row.t < s.judged_from {
                continue;
            }
            for (score, e) in scores
                .iter_mut()
                .zip(set.estimates().iter().chain([&fused]))
            {
                score.add(e.tau, *tau);
            }
        }
        let figures: Vec<_> = scores.iter().map(|s| s.figures().unwrap()).collect();
        let best = figures[..names.len() - 1]
            .iter()
            .map(|f| f.rms)
            .fold(f64::MAX, f64::min);
        print!("{:14} ", s.name);
        for f in &figures {
            print!("{:>9.2}% {:5.2}", f.rms_percent, f.delay_s * 1e3);
        }
        println!(
            "  fused/best {:.3}  rms tau {:.2}",
            figures[names.len() - 1].rms / best,
            100.0 * best
                / figures
                    .iter()
                    .map(|f| f.rms_percent)
                    .fold(f64::MAX, f64::min)
        );
    }
}
