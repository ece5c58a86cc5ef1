mod common;
use can_codec::Frames;
use common::*;
use cycle::{Cycle, Wanted};
use plant::{CanRobot, SimParameters};
use robot_state::mode;
fn rd(p: &str) -> std::io::Result<String> {
    std::fs::read_to_string(format!("{}/../../{p}", env!("CARGO_MANIFEST_DIR")))
}
fn bench(f: impl Fn(&mut robot_config::Robot), g: impl Fn(&mut SimParameters)) -> Bench {
    let mut b = Bench::new("humanoid");
    let mut robot = robot_config::load("config/humanoid/robot.toml", &rd).unwrap();
    f(&mut robot);
    let mut sim = SimParameters::parse(&rd("config/humanoid/sim.toml").unwrap(), "s").unwrap();
    g(&mut sim);
    let urdf = rd(&robot.parameters.urdf_path).unwrap();
    b.plant = CanRobot::new(&robot, &urdf, &sim).unwrap();
    b.cycle = Cycle::new(&robot).unwrap();
    b.robot = robot;
    b
}

fn motions() -> Vec<(String, f64, f64)> {
    let t = rd("config/humanoid/motion.toml").unwrap();
    let mut v: Vec<(String,f64,f64)> = vec![];
    for l in t.lines() {
        let Some((k, x)) = l.split_once('=') else { continue };
        let x = x.split('#').next().unwrap().trim().trim_matches('"').to_string();
        match k.trim() { "name" => v.push((x, 0.0, 1.0)), "amplitude_deg" => v.last_mut().unwrap().1 = x.parse::<f64>().unwrap().to_radians(), "period_s" => v.last_mut().unwrap().2 = x.parse().unwrap(), _ => {} }
    }
    v
}
fn go(name: &str, mut b: Bench, m: u32, given: u32) {
    let n = 30;
    b.run(300);
    let mut r = b.reference(m, 1);
    r.contact_given = given;
    let names: Vec<String> = b.robot.parameters.joints.iter().map(|j| j.name.clone()).collect();
    let start: Vec<f64> = (0..n).map(|j| r.joints[j].q_d).collect();
    let mo = motions();
    println!("== {name}");
    let mut hist: Vec<Vec<f64>> = vec![];
    let (mut e_wb, mut e_en, mut big) = (vec![0.0f64; n], vec![0.0f64; n], vec![0.0f64; n]);
    let mut count = 0.0;
    for s in 0..10 {
        let mut dqmax = vec![0.0f64; n];
        for k in 0..1000 {
            r.sequence += 1;
            let t = (s * 1000 + k) as f64 * 1e-3 - 1.0;
            if t > 0.0 { for (name, a, p) in &mo {
                let Some(j) = names.iter().position(|x| x == name) else { if hist.len() == 1001 { println!("?? {name}"); } continue };
                let w = std::f64::consts::TAU / p;
                r.joints[j].q_d = start[j] + 0.5 * a * (1.0 - (w * t).cos());
                r.joints[j].dq_d = 0.5 * a * w * (w * t).sin();
                r.joints[j].ddq_d = 0.5 * a * w * w * (w * t).cos();
            } }
            let rec = *b.step(&wanted(&r));
            let tr = b.plant.truth();
            hist.push(tr.joints.iter().map(|j| j.tau).collect());
            for j in 0..n { dqmax[j] = dqmax[j].max(tr.joints[j].dq.abs()); 
              if hist.len() > 500 { let h = hist.len()-1;
                let at = |d: f64| { let x = d*1e3; let (i,f)=(x.floor() as usize, x.fract()); hist[h-i][j]*(1.0-f)+hist[h-i-1][j]*f };
                let (w, e) = (rec.joints[j].tau_whole_body, rec.joints[j].tau_encoder);
                e_wb[j] += (w.tau - at(w.delay_s)).powi(2); e_en[j] += (e.tau - at(e.delay_s)).powi(2); big[j] = big[j].max(hist[h][j].abs());
              } }
            if hist.len() > 500 { count += 1.0; }
        }
        let t = b.plant.truth();
        let tilt = 2.0 * f64::hypot(t.base_orientation[0], t.base_orientation[1]);
        let mut o: Vec<usize> = (0..n).collect();
        o.sort_by(|a, c| dqmax[*c].total_cmp(&dqmax[*a]));
        let worst: Vec<String> = o[..4].iter().map(|j| format!("{} {:.3}", names[*j], dqmax[*j])).collect();
        let drift = (0..n).fold(0.0f64, |m, j| m.max((t.joints[j].q - r.joints[j].q_d).abs()));
        if s % 3 == 0 { println!("{}s tilt {:.4} z {:.3} mode {} drift {:.4} dq {}", s + 1, tilt, t.base_position[2], b.cycle.record().mode, drift, worst.join(", ")); }
    }
    for j in 0..n { print!("{} max {:.2} enc {:.1}% ft {:.2}% | ", names[j], big[j], 100.0*(e_en[j]/count).sqrt()/big[j], 100.0*(e_wb[j]/count).sqrt()/big[j]); }
    println!();
    let _ = Frames::new(1);
    let _ = Wanted::default();
}
fn gains(kp: f64, ks: f64) -> impl Fn(&mut robot_config::Robot) {
    move |r| {
        for j in &mut r.parameters.joints {
            j.gains.k_p = kp;
            j.gains.k_s *= ks;
            j.gains.k_d *= ks;
        }
    }
}

fn nokin(r: &mut robot_config::Robot) { gains(0.0, 3.0)(r); for j in &mut r.parameters.joints { j.estimator.kinematic_error.link.clear(); j.estimator.kinematic_error.motor.clear(); } }
fn nokins(s: &mut SimParameters) { for d in s.drives.values_mut() { d.kinematic_error.link.clear(); d.kinematic_error.motor.clear(); } }
#[test]
fn exp() {
    let id = mode::INVERSE_DYNAMICS;
    go("base", bench(gains(0.0, 3.0), |_| {}), id, 0);
    go("no kin", bench(nokin, nokins), id, 0);
    go("no inertia error", bench(gains(0.0, 3.0), |s| s.inertia_error = 0.0), id, 0);
    go("no ft errors", bench(gains(0.0, 3.0), |s| s.ft_sensor = Default::default()), id, 0);
    go("no imu errors", bench(gains(0.0, 3.0), |s| s.imu = Default::default()), id, 0);
    go("no stiction", bench(gains(0.0, 3.0), |s| for d in s.drives.values_mut() { d.friction.static_ratio = 1.0; d.friction.ripple = 0.0; }), id, 0);
    go("all", bench(nokin, |s| { nokins(s); s.inertia_error = 0.0; s.ft_sensor = Default::default(); s.imu = Default::default(); for d in s.drives.values_mut() { d.friction.static_ratio = 1.0; d.friction.ripple = 0.0; d.friction.coulomb *= 0.01; }}), id, 0);
}
