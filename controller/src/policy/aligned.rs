//! Bytes at an address that the weights can be read from.

/// Bytes aligned to 4, as [`Policy::parse`](super::Policy::parse) wants them.
#[repr(C, align(4))]
#[derive(Clone, Copy, Debug)]
pub struct Aligned<T: ?Sized>(pub T);

impl<const N: usize> core::ops::Deref for Aligned<[u8; N]> {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        &self.0
    }
}

/// A policy file as aligned bytes in the image: `&'static [u8]`.
#[macro_export]
macro_rules! include_policy {
    ($path:expr $(,)?) => {{
        static BLOB: &$crate::policy::Aligned<[u8]> =
            &$crate::policy::Aligned(*include_bytes!($path));
        &BLOB.0
    }};
}
