//! Power failures between any two operations of the flash, and within an erase.

use std::cell::Cell;
use std::rc::Rc;

use crate::rig::{Rig, factory, small_blob};
use embedded_storage::nor_flash::{ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash};
use leg_control::serial::message::{Request, RequestError, Slot};
use leg_control::serial::slots::{MappedFlash, SEAL_LEN};
use leg_host::flash::MemoryFlash;

/// Flash whose power fails after so many operations, and which does nothing from
/// then on. It counts the erases of each slot.
#[derive(Clone)]
struct Failing {
    memory: MemoryFlash,
    left: Rc<Cell<u32>>,
    erased: Rc<Cell<[u32; 2]>>,
    /// What an erase leaves that the power failure cuts short.
    half_erase: HalfErase,
}

/// Which part of a slot an erase that is cut short has done.
#[derive(Clone, Copy, PartialEq)]
enum HalfErase {
    Nothing,
    Blob,
    Seal,
}

impl Failing {
    fn new(memory: MemoryFlash, operations: u32, half_erase: HalfErase) -> Self {
        let left = Rc::new(Cell::new(operations));
        Self { memory, left, erased: Rc::default(), half_erase }
    }

    fn powered(&self) -> bool {
        let left = self.left.get();
        self.left.set(left.saturating_sub(1));
        left > 0
    }

    /// Erases one part of a slot.
    fn half_erase(&mut self, slot: Slot) {
        let len = self.memory.capacity() / 2;
        let mut image = self.memory.mapped()[len * slot as usize..][..len].to_vec();
        let seal_at = image.len() - SEAL_LEN;
        match self.half_erase {
            HalfErase::Nothing => {}
            HalfErase::Blob => image[..seal_at].fill(0xff),
            HalfErase::Seal => image[seal_at..].fill(0xff),
        }
        self.memory = self.memory.clone().loaded(slot, &image);
    }
}

impl ErrorType for Failing {
    type Error = NorFlashErrorKind;
}

impl ReadNorFlash for Failing {
    const READ_SIZE: usize = MemoryFlash::READ_SIZE;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        self.memory.read(offset, bytes)
    }

    fn capacity(&self) -> usize {
        self.memory.capacity()
    }
}

impl NorFlash for Failing {
    const WRITE_SIZE: usize = MemoryFlash::WRITE_SIZE;
    const ERASE_SIZE: usize = MemoryFlash::ERASE_SIZE;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        let slot = if from == 0 { Slot::A } else { Slot::B };
        if self.left.get() == 1 && self.half_erase != HalfErase::Nothing {
            self.half_erase(slot);
        }
        if !self.powered() || (self.left.get() == 0 && self.half_erase != HalfErase::Nothing) {
            return Err(NorFlashErrorKind::Other);
        }
        let mut erased = self.erased.get();
        erased[slot as usize] += 1;
        self.erased.set(erased);
        self.memory.erase(from, to)
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        if self.powered() {
            self.memory.write(offset, bytes)
        } else {
            Err(NorFlashErrorKind::Other)
        }
    }
}

impl MappedFlash for Failing {
    const ERASE_STALLS: bool = false;

    fn mapped(&self) -> &'static [u8] {
        self.memory.mapped()
    }
}

/// A board with `second` in B, committed over `first` in A.
fn second_generation() -> MemoryFlash {
    let mut rig = Rig::power_up(factory(&small_blob("first")));
    rig.upload(&small_blob("second")).unwrap();
    rig.flash().clone()
}

#[test]
fn a_power_cut_between_any_two_operations_of_an_upload_leaves_a_valid_policy() {
    let new = small_blob("third");
    for half_erase in [HalfErase::Nothing, HalfErase::Blob, HalfErase::Seal] {
        for operations in 0.. {
            let flash = Failing::new(second_generation(), operations, half_erase);
            let mut rig = Rig::power_up(flash);
            let uploaded = rig.upload(&new);
            let runs = if uploaded.is_ok() { "third" } else { "second" };
            assert_eq!(rig.name(), runs);
            // The last word may be written although no answer came: either slot is whole.
            assert_eq!(rig.power_cycled().name(), runs, "after {operations} operations");
            match uploaded {
                Ok(()) => {
                    assert_eq!(rig.flash().left.get(), 0);
                    assert!(operations as usize > new.len() / 4);
                    break;
                }
                Err(refusal) => {
                    assert!(
                        matches!(refusal, RequestError::Flash | RequestError::NotBegun),
                        "{refusal:?}"
                    );
                }
            }
        }
    }
}

/// Found in thought: the seal erased and the blob not yet, a policy that was
/// rolled back looked like one from the factory, and A's wins a tie.
#[test]
fn a_policy_rolled_back_does_not_return_when_its_erase_is_cut_short() {
    for operations in 0..4 {
        let [a, b] = ["bad", "good"].map(small_blob);
        let mut rig = Rig::power_up(factory(&a).loaded(Slot::B, &b));
        rig.order(&Request::RollBack).unwrap();
        assert_eq!(rig.name(), "good");
        let flash = Failing::new(rig.flash().clone(), operations, HalfErase::Seal);
        let mut rig = Rig::power_up(flash);
        let _ = rig.begin(&a);
        assert_eq!(rig.power_cycled().name(), "good", "after {operations} operations");
    }
}

#[test]
fn a_power_cut_during_a_roll_back_leaves_one_of_the_two_policies() {
    for operations in 0..=1 {
        let flash = Failing::new(second_generation(), operations, HalfErase::Nothing);
        let mut rig = Rig::power_up(flash);
        let rolled_back = rig.order(&Request::RollBack).is_ok();
        assert_eq!(rolled_back, operations == 1);
        let runs = if rolled_back { "first" } else { "second" };
        assert_eq!((rig.name(), rig.power_cycled().name()), (runs, runs));
    }
}

#[test]
fn a_flash_failure_ends_only_the_upload() {
    let new = small_blob("third");
    let flash = Failing::new(second_generation(), 40, HalfErase::Nothing);
    let mut rig = Rig::power_up(flash);
    rig.begin(&new).unwrap();
    assert_eq!(rig.chunk(&new, 0), Err(RequestError::Flash));
    assert_eq!(rig.chunk(&new, 0), Err(RequestError::NotBegun));
    rig.flash().left.set(u32::MAX);
    rig.upload(&new).unwrap();
    assert_eq!(rig.name(), "third");
}

#[test]
fn the_slot_of_a_policy_that_runs_or_waits_is_never_erased() {
    let flash = Failing::new(factory(&small_blob("first")), u32::MAX, HalfErase::Nothing);
    let mut rig = Rig::power_up(flash);
    rig.hop();
    let mut expected = [0, 0];
    for round in 0..10 {
        let idle = rig.running().unwrap().slot.other();
        rig.upload(&small_blob(["even", "odd"][round % 2])).unwrap();
        expected[idle as usize] += 1;
        assert_eq!(rig.flash().erased.get(), expected);
        // It waits: both slots are taken.
        for request in [Request::Begin { length: 64, crc32: 0, origin: "" }, Request::RollBack] {
            assert_eq!(rig.order(&request), Err(RequestError::SwapPending));
        }
        assert_eq!(rig.flash().erased.get(), expected);
        rig.ticks(super::rig::HOP_TICKS);
        assert_eq!(rig.running().unwrap().slot, idle);
    }
}
