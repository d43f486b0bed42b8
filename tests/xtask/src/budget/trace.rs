//! Cuts QEMU's log of executed instructions into the calls of the counted functions.
//!
//! With `-singlestep -d exec,nochain` QEMU writes a line for every instruction
//! before it runs, such as
//! `Trace 0: 0x7f3f0c000400 [00800408/0000294e/00000110/ff000201] symbol`:
//! the second of the four is the address.

use std::collections::BTreeMap;

/// Returns the address in a line of the log, `None` for a line of another kind.
pub(super) fn address_of(line: &str) -> Option<u32> {
    let fields = line.strip_prefix("Trace ")?.split_once('[')?.1;
    u32::from_str_radix(fields.split('/').nth(1)?, 16).ok()
}

/// Cuts the stream of addresses into calls of the watched functions: from the first
/// instruction to the return behind the call. A watched function that another one calls
/// counts in both.
pub(super) struct Calls<'a> {
    watched: &'a BTreeMap<u32, String>,
    open: Vec<Open>,
    done: Vec<Call>,
    previous: Option<u32>,
    length_of: &'a dyn Fn(u32) -> Option<u32>,
}

/// A call that has not returned yet.
struct Open {
    function: String,
    back: u32,
    addresses: Vec<u32>,
}

/// A call that has returned.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Call {
    /// Name of the function.
    pub(super) function: String,
    /// Addresses of all instructions in the order of execution.
    pub(super) addresses: Vec<u32>,
}

impl<'a> Calls<'a> {
    /// Watches functions, given by entry address and name. `length_of` returns the bytes
    /// of the instruction at an address.
    pub(super) fn new(
        watched: &'a BTreeMap<u32, String>,
        length_of: &'a dyn Fn(u32) -> Option<u32>,
    ) -> Self {
        Self { watched, open: Vec::new(), done: Vec::new(), previous: None, length_of }
    }

    /// Takes the address of the next instruction.
    pub(super) fn push(&mut self, address: u32) {
        while self.open.last().is_some_and(|call| call.back == address) {
            let Open { function, addresses, .. } = self.open.pop().expect("just seen");
            self.done.push(Call { function, addresses });
        }
        if let (Some(function), Some(caller)) = (self.watched.get(&address), self.previous) {
            let back = caller + (self.length_of)(caller).unwrap_or(4);
            self.open.push(Open { function: function.clone(), back, addresses: Vec::new() });
        }
        for call in &mut self.open {
            call.addresses.push(address);
        }
        self.previous = Some(address);
    }

    /// Returns the completed calls in the order of their returns.
    pub(super) fn finish(self) -> Vec<Call> {
        self.done
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_address_is_the_second_field() {
        let line = "Trace 0: 0x7f3f0c000400 [00800408/0000294e/00000110/ff000201] main";
        assert_eq!(address_of(line), Some(0x294e));
        assert_eq!(address_of("qemu: something else"), None);
        assert_eq!(address_of("Trace 0: 0x7f [zz/zz]"), None);
    }

    #[test]
    fn a_call_lasts_until_the_return_behind_its_branch() {
        let watched = BTreeMap::from([(0x200, "outer".to_owned()), (0x300, "inner".to_owned())]);
        let length_of = |_: u32| Some(4);
        let mut calls = Calls::new(&watched, &length_of);
        // main calls outer, outer calls inner, back, back; inner alone; one cut off.
        for address in
            [0x100, 0x200, 0x204, 0x300, 0x302, 0x208, 0x20a, 0x104, 0x300, 0x108, 0x200, 0x204]
        {
            calls.push(address);
        }
        let call = |function: &str, addresses: &[u32]| Call {
            function: function.to_owned(),
            addresses: addresses.to_vec(),
        };
        assert_eq!(
            calls.finish(),
            [
                call("inner", &[0x300, 0x302]),
                call("outer", &[0x200, 0x204, 0x300, 0x302, 0x208, 0x20a]),
                call("inner", &[0x300]),
            ]
        );
    }
}
