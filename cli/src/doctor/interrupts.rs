//! Interrupts: which CPUs they come to, those of the CAN adapters first.

use super::finding::Findings;
use super::machine::{Machine, cpus, list};
use std::collections::BTreeSet;
use std::path::PathBuf;

/// An interrupt line of `/proc/interrupts`.
struct Line {
    number: String,
    /// Since boot, by CPU.
    counts: Vec<(usize, u64)>,
    /// What has it.
    name: String,
}

pub(super) fn check(machine: &Machine, findings: &mut Findings) {
    // Which CPU should be spared is known only where the loop has one.
    let Some(cpu) = machine.loop_cpu() else {
        return;
    };
    let lines = lines(&machine.root.text("/proc/interrupts"));
    let of_can = of_adapters(machine);
    let target = machine.housekeeping_cpus();
    if target.is_empty() {
        return;
    }
    for line in lines {
        let at = format!("/proc/irq/{}", line.number);
        let allowed = cpus(&machine.root.text(&format!("{at}/smp_affinity_list")));
        let came = line
            .counts
            .iter()
            .any(|&(on, count)| on == cpu && count > 0);
        if !came || !allowed.contains(&cpu) {
            continue;
        }
        let is_can = of_can.contains(&line.number);
        let id = if is_can { "can-interrupt" } else { "interrupt" };
        let what = format!(
            "interrupt {} ({}) comes to CPU {cpu} of the loop",
            line.number, line.name
        );
        let why = "its handler runs before the loop, for up to a tenth of a millisecond";
        let texts = vec![(format!("{at}/smp_affinity_list"), list(&target))];
        findings.writable(id, what, why, texts);
    }
}

fn lines(text: &str) -> Vec<Line> {
    let mut rows = text.lines();
    let heading = rows.next().unwrap_or_default().split_whitespace();
    let on: Vec<usize> = heading
        .filter_map(|name| name.strip_prefix("CPU")?.parse().ok())
        .collect();
    let numbered = rows.filter_map(|row| {
        let (number, rest) = row.trim().split_once(':')?;
        number.parse::<u32>().ok()?;
        let cells: Vec<&str> = rest.split_whitespace().collect();
        let counts = on
            .iter()
            .zip(&cells)
            .filter_map(|(&cpu, cell)| Some((cpu, cell.parse().ok()?)));
        let counts: Vec<_> = counts.collect();
        let name = cells
            .get(counts.len()..)
            .unwrap_or_default()
            .last()
            .copied()
            .unwrap_or("unnamed");
        Some(Line {
            number: number.to_owned(),
            counts,
            name: name.to_owned(),
        })
    });
    numbered.collect()
}

/// Numbers of the interrupts that CAN adapters have, or the USB or PCI devices that they hang on.
fn of_adapters(machine: &Machine) -> BTreeSet<String> {
    const NET: &str = "/sys/class/net";
    let root = &machine.root;
    let mut numbers = BTreeSet::new();
    for interface in super::links::can_interfaces(root) {
        let device = root.path(&format!("{NET}/{interface}/device"));
        let mut folder: Option<PathBuf> = device.canonicalize().ok();
        while let Some(at) = folder {
            let entries = std::fs::read_dir(at.join("msi_irqs"))
                .into_iter()
                .flatten()
                .flatten();
            let found: Vec<String> = entries
                .filter_map(|entry| entry.file_name().into_string().ok())
                .collect();
            let line = std::fs::read_to_string(at.join("irq"))
                .ok()
                .map(|text| text.trim().to_owned());
            if !found.is_empty() || line.is_some() {
                numbers.extend(found);
                numbers.extend(line.filter(|number| number != "0"));
                break;
            }
            folder = at
                .parent()
                .map(PathBuf::from)
                .filter(|parent| parent.starts_with(root.path("/sys")));
        }
    }
    numbers
}

#[cfg(test)]
mod tests {
    use super::lines;

    #[test]
    fn interrupts_are_read_as_the_kernel_writes_them() {
        let text = "            CPU0       CPU2\n  0:         44          0  IO-APIC   2-edge      timer\n \
                    42:          0       1234  PCI-MSI 524288-edge      can0\nNMI:          1          1   Non-maskable interrupts\n";
        let found = lines(text);
        assert_eq!(found.len(), 2);
        assert_eq!(found[1].number, "42");
        assert_eq!(found[1].counts, [(0, 0), (2, 1234)]);
        assert_eq!(found[1].name, "can0");
    }
}
