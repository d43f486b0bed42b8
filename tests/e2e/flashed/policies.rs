//! Policies to swap between.

use leg_control::policy::{Manifest, Policy, SHIPPED, write};
use leg_process::policy_file::AlignedBytes;

/// Returns the shipped policy with other gains and other limits, which hops as well.
pub(crate) fn sibling() -> &'static [u8] {
    let policy = Policy::parse(SHIPPED).expect("the shipped policy");
    let mut manifest = Manifest { name: "sibling", ..policy.manifest().clone() };
    manifest.action.high[0] -= 0.05;
    manifest.action.low[0] += 0.05;
    for gains in &mut manifest.gains {
        gains.ki *= 0.9;
        gains.kp *= 0.9;
    }
    let mut bytes = AlignedBytes::zeros(SHIPPED.len() + 64);
    let len = write(&manifest, policy.actor().weights(), bytes.as_mut_slice()).expect("a policy");
    bytes.truncate(len);
    // For the whole test, because controllers borrow it.
    Box::leak(Box::new(bytes)).as_slice()
}
