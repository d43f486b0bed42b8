//! Conformance suite of links, which every transport passes, bare and behind fault injection.

mod checks;
mod transports;

use sim_host::faults::stage::FaultPlan;

use transports::{Faulty, Memory, Serial, SharedMemory, Transport, all_inactive};

/// Runs the whole suite.
fn check<T: Transport>(transport: &T) {
    for check in checks::all() {
        check(transport);
    }
}

/// Runs the suite with both ends wrapped, without any fault and with idle ones.
fn check_wrapped<T: Transport>(inner: impl Fn() -> T) {
    for plan in [FaultPlan::default, all_inactive] {
        check(&Faulty { inner: inner(), plan });
    }
}

#[test]
fn in_memory_link_conforms() {
    check(&Memory);
}

#[test]
fn serial_link_conforms() {
    check(&Serial);
}

#[test]
fn shared_memory_link_conforms() {
    let transport = SharedMemory::new();
    check(&transport);
    transport.assert_clean();
}

#[test]
fn every_transport_conforms_behind_fault_injection() {
    check_wrapped(|| Serial);
    check_wrapped(|| Memory);
    check_wrapped(SharedMemory::new);
}
