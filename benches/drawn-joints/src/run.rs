//! Runs of many joints.

use crate::catalogue::Catalogue;
use crate::config::Bristles;
use crate::draw::Drawn;
use crate::tasks::{self, Extent, Figures};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// A joint and its figures; none where `torquectl check` refuses it.
pub(crate) type Judged = (Drawn, Option<Figures>);

/// Joints of the seeds from 0 on until `count` of them pass `check`, of each shipped joint in turn, in the order of the
/// seeds.
///
/// # Errors
/// Files, or a robot that the cycle cannot run.
pub(crate) fn joints(
    count: usize,
    threads: usize,
    bristles: Bristles,
    extent: Extent,
) -> Result<Vec<Judged>, String> {
    let catalogue = Catalogue::all()?;
    let next = AtomicUsize::new(0);
    let done: Mutex<Vec<(usize, Result<Judged, String>)>> = Mutex::default();
    let passed = |done: &[(usize, Result<Judged, String>)]| {
        let passes = |it: &&(usize, Result<Judged, String>)| !matches!(it.1, Ok((_, None)));
        done.iter().filter(passes).count()
    };
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                while done.lock().is_ok_and(|done| passed(&done) < count) {
                    let seed = next.fetch_add(1, Ordering::Relaxed);
                    let drawn = Drawn::new(&catalogue[seed % catalogue.len()], seed as u64);
                    let figures = tasks::joint(&drawn, bristles, extent);
                    eprintln!("{}: {figures:?}", drawn.name);
                    if let Ok(mut done) = done.lock() {
                        done.push((seed, figures.map(|figures| (drawn, figures))));
                    }
                }
            });
        }
    });
    let mut done = done.into_inner().unwrap_or_default();
    done.sort_by_key(|(seed, _)| *seed);
    // Threads may have finished one joint more than was asked for.
    while passed(&done) > count {
        done.pop();
    }
    done.into_iter().map(|(_, judged)| judged).collect()
}

/// Prints a joint.
///
/// # Errors
/// As [`joints`].
pub(crate) fn one(seed: u64) -> Result<(), String> {
    let catalogue = Catalogue::all()?;
    let drawn = Drawn::new(&catalogue[seed as usize % catalogue.len()], seed);
    println!("{drawn:#?}");
    let figures = tasks::joint(&drawn, Bristles::Known, Extent::ALL)?;
    println!("{figures:#?}");
    Ok(())
}
