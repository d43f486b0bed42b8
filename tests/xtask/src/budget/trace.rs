//! From QEMU's log of executed instructions to the calls of one figure.
//!
//! With `-singlestep -d exec,nochain` QEMU writes a line for every instruction
//! before it runs, such as
//! `Trace 0: 0x7f3f0c000400 [00800408/0000294e/00000110/ff000201] symbol`:
//! the second of the four is the address.

use std::collections::BTreeMap;

/// The address in a line of the log; `None` for a line of another kind.
pub(super) fn address_of(line: &str) -> Option<u32> {
    let fields = line.strip_prefix("Trace ")?.split_once('[')?.1;
    u32::from_str_radix(fields.split('/').nth(1)?, 16).ok()
}

/// Cuts the stream of addresses into calls of the functions that are watched:
/// from a function's first instruction until the return to what follows its
/// call. A watched function called by a watched one counts in both.
pub(super) struct Calls<'a> {
    watched: &'a BTreeMap<u32, String>,
    open: Vec<Open>,
    done: Vec<Call>,
    previous: Option<u32>,
    length_of: &'a dyn Fn(u32) -> Option<u32>,
}

/// A call that has not returned yet.
struct Open {
    figure: String,
    back: u32,
    addresses: Vec<u32>,
}

/// A call that has returned.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Call {
    /// The function's name.
    pub(super) figure: String,
    /// Every instruction's address, in the order of execution.
    pub(super) addresses: Vec<u32>,
}

impl<'a> Calls<'a> {
    /// `watched`: entry addresses and names; `length_of`: an instruction's bytes.
    pub(super) fn new(
        watched: &'a BTreeMap<u32, String>,
        length_of: &'a dyn Fn(u32) -> Option<u32>,
    ) -> Self {
        Self { watched, open: Vec::new(), done: Vec::new(), previous: None, length_of }
    }

    /// The next instruction.
    pub(super) fn push(&mut self, address: u32) {
        while self.open.last().is_some_and(|call| call.back == address) {
            let Open { figure, addresses, .. } = self.open.pop().expect("just seen");
            self.done.push(Call { figure, addresses });
        }
        if let (Some(figure), Some(caller)) = (self.watched.get(&address), self.previous) {
            let back = caller + (self.length_of)(caller).unwrap_or(4);
            self.open.push(Open { figure: figure.clone(), back, addresses: Vec::new() });
        }
        for call in &mut self.open {
            call.addresses.push(address);
        }
        self.previous = Some(address);
    }

    /// The calls that returned, in the order of their returns.
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
        let call = |figure: &str, addresses: &[u32]| Call {
            figure: figure.to_owned(),
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
