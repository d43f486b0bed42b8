//! The order of the weights in memory: the order in which the kernel reads them.
//!
//! It is part of the file format. Row-major weights in the file, packed when they are
//! loaded, would leave the format free of the kernel's register allocation, but would
//! cost 12 kB of RAM on the target.

/// Rows side by side in the packed weights: as many sums as a Cortex-M4F holds in
/// registers beside a column of weights.
pub const PANEL_ROWS: usize = 10;

/// Passes one layer, row-major `weights` of shape (outputs, inputs) and `bias`
/// of length outputs, to `put` in the order of the kernel: for each panel of
/// [`PANEL_ROWS`] rows (the last may be narrower) its biases, then its first
/// column, its second, and so on.
pub fn pack(weights: &[f32], bias: &[f32], inputs: usize, mut put: impl FnMut(f32)) {
    let rows_of_panel = weights.chunks(PANEL_ROWS * inputs.max(1));
    for (rows, biases) in rows_of_panel.zip(bias.chunks(PANEL_ROWS)) {
        for &b in biases {
            put(b);
        }
        for column in 0..inputs {
            rows.iter().skip(column).step_by(inputs).for_each(|&w| put(w));
        }
    }
}
