//! The buses, open for questions and answers.

use can_codec::{Frame, Frames, Gather, MAX_FRAMES, Table};
use robot_config::BusParameters;
use torqued::bus::{Bus, Network, Waiting};
use torqued::bus_lock::BusLocks;
use torqued::failure::Failure;

/// Time between two looks, ns.
const LOOK_NS: u64 = 1_000_000;

/// Buses that nobody else of us uses while this lives.
pub(super) struct Line {
    network: Network,
    table: Table,
    gather: Gather,
    _locks: BusLocks,
}

impl Line {
    pub(super) fn open(buses: &[BusParameters]) -> Result<Self, Failure> {
        let network = Network::open(buses)?;
        let locks = BusLocks::take(buses.iter().map(|bus| &bus.carrier));
        let table = Table::compile(&[], &[]).map_err(|_| Failure::environment("no empty table"))?;
        Ok(Self {
            network,
            gather: Gather::only(&[]),
            table,
            _locks: locks.map_err(Failure::environment)?,
        })
    }

    /// Gives frames as they arrive and takes those to send, until the turn says that it is over.
    pub(super) fn run(&mut self, mut turn: impl FnMut(&[Frame], u64, &mut Vec<Frame>) -> bool) {
        let (mut rx, mut tx) = (Frames::default(), Frames::default());
        let mut out = Vec::with_capacity(MAX_FRAMES);
        loop {
            let over = turn(rx.as_slice(), self.network.now_ns(), &mut out);
            tx.clear();
            for frame in out.drain(..) {
                tx.push(frame);
            }
            if !tx.is_empty() {
                // A question that the kernel does not take is sent again, or its drive is missed.
                self.network.send(&tx);
            }
            if over {
                return;
            }
            let now = self.network.now_ns();
            self.network.wait(now + LOOK_NS);
            rx.clear();
            self.gather.begin();
            self.network
                .receive(&mut rx, &mut self.gather, &self.table, 0);
        }
    }
}

/// Every CAN interface of the machine.
pub(super) fn interfaces(fd: bool) -> Result<Vec<BusParameters>, Failure> {
    /// `ARPHRD_CAN` of the kernel.
    const CAN: &str = "280";
    let folder = std::fs::read_dir("/sys/class/net").map_err(Failure::environment)?;
    let mut names: Vec<String> = folder
        .flatten()
        .filter(|entry| {
            let kind = std::fs::read_to_string(entry.path().join("type"));
            kind.is_ok_and(|kind| kind.trim() == CAN)
        })
        .filter_map(|entry| entry.file_name().into_string().ok())
        .collect();
    names.sort();
    if names.is_empty() {
        let what = "this machine has no CAN interface; allowed: --bus GROUP:PORT, or a CONFIG";
        return Err(Failure::environment(what));
    }
    let buses = names.iter().map(|name| super::bus_parameters(name, fd));
    buses.collect()
}
