//! C99: an actor as one source file, for firmware that is not in Rust.
//!
//! The template `leg_actor.c` beside this file has everything but the numbers. These are
//! written in hexadecimal, which is exact. Operations and their order are those of
//! [`leg_control::actor`], and tanh is that of the crate `libm`, so the bits agree.

use crate::policy::PackedActor;
use leg_control::actor::{Activation, Activations, GELU_CUBE, GELU_SLOPE, OutputActivation};
use leg_control::policy::{Policy, TestVector};
use std::fmt::Write;

/// The source, with `@MARKS@` for the policy's own parts.
const TEMPLATE: &str = include_str!("leg_actor.c");

const RELU: &str = "\
static void leg_hidden(float *x, int count)
{
    int i;

    /* By bits: -0, everything below and NaN give +0. */
    for (i = 0; i < count; i++)
        if (leg_to_bits(x[i]) - 1u >= 0x7f800000u)
            x[i] = 0.0f;
}

";

/// Any other activation, with `@EXPRESSION@` of `x[i]`.
const OTHER: &str = "\
static void leg_hidden(float *x, int count)
{
    int i;

    for (i = 0; i < count; i++)
        x[i] = @EXPRESSION@;
}

";

/// Returns the function between the layers, in the operations of [`Activation::of`].
fn hidden_function(activation: Activation) -> String {
    let positive = |other: String| format!("x[i] > 0.0f ? x[i] : {other}");
    // x (1/2 + 1/2 tanh(..))
    let gated =
        |inner: &str| format!("leg_mul(x[i], leg_add(0.5f, leg_mul(0.5f, leg_tanhf({inner}))))");
    let expression = match activation {
        Activation::LeakyRelu(slope) => positive(format!("leg_mul({}, x[i])", hex(slope))),
        Activation::Elu(scale) => positive(format!("leg_mul({}, leg_expm1f(x[i]))", hex(scale))),
        Activation::Tanh => "leg_tanhf(x[i])".into(),
        Activation::Silu => gated("leg_mul(0.5f, x[i])"),
        Activation::GeluTanh => gated(&format!(
            "leg_mul({}, leg_add(x[i], leg_mul({}, leg_mul(leg_mul(x[i], x[i]), x[i]))))",
            hex(GELU_SLOPE),
            hex(GELU_CUBE)
        )),
        _ => return RELU.into(),
    };
    OTHER.replace("@EXPRESSION@", &expression)
}

/// What the names in the file begin with by default.
pub const PREFIX: Prefix<'static> = Prefix("leg");
/// Longest prefix, bytes: C99 tells names apart by their first 31 characters, and the longest
/// suffix is `_observation_offset`.
const MOST_PREFIX_BYTES: usize = 12;

/// What all names in the file begin with: `leg` gives the function `leg_actor`. Files with
/// different prefixes can be linked into one program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Prefix<'a>(&'a str);

impl<'a> Prefix<'a> {
    /// Checks a prefix: lower-case letters and digits, and underscores within, at most 12.
    ///
    /// # Errors
    /// Returns what a prefix must be.
    pub fn new(text: &'a str) -> Result<Self, String> {
        let fine = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
        let begins = text.starts_with(|c: char| c.is_ascii_lowercase());
        if text.len() <= MOST_PREFIX_BYTES
            && begins
            && text.chars().all(fine)
            && !text.contains("__")
        {
            return Ok(Self(text));
        }
        Err(format!(
            "a prefix is a lower-case letter, then lower-case letters, digits and single \
             underscores, at most {MOST_PREFIX_BYTES} in all"
        ))
    }
}

/// Writes a policy's actor as C source, with its test vectors as a self-test.
#[must_use]
pub fn export(policy: &Policy<'_>, vectors: &[TestVector], prefix: Prefix<'_>) -> String {
    let packed = PackedActor::from(policy);
    let layers = packed.layers();
    let (o, a) = (&packed.observation, &packed.action);
    let widest = packed.widths.iter().max().copied().unwrap_or_default();
    let mut tables = format!("#define LEG_WIDEST {widest}\n\n");
    tables += &table("leg_observation_offset", &o.offset, 3);
    tables += &table("leg_observation_scale", &o.scale, 3);
    tables += &table("leg_action_offset", &a.offset, 2);
    tables += &table("leg_action_scale", &a.scale, 2);
    tables += &table("leg_action_low", &a.low, 2);
    tables += &table("leg_action_high", &a.high, 2);
    let mut calls = String::new();
    let [mut from, mut to] = ["front", "back"];
    for (i, layer) in layers.iter().enumerate() {
        let (inputs, outputs) = (layer.inputs, layer.bias.len());
        tables += &table(&format!("leg_bias_{i}"), &layer.bias, 8);
        tables += &table(&format!("leg_weight_{i}"), &layer.weights, inputs);
        let arguments = format!("leg_weight_{i}, leg_bias_{i}, {inputs}, {outputs}, {from}, {to}");
        let _ = writeln!(calls, "    leg_dense({arguments});");
        if i + 1 < layers.len() {
            let _ = writeln!(calls, "    leg_hidden({to}, {outputs});");
        }
        std::mem::swap(&mut from, &mut to);
    }
    let Activations { hidden, output } = packed.activations;
    let hidden = if layers.len() > 1 { hidden_function(hidden) } else { String::new() };
    let output = match output {
        OutputActivation::Tanh => format!("leg_tanhf({from}[i])"),
        _ => format!("{from}[i]"),
    };
    let text = hidden.clone() + &output;
    let is_called = |name: &str| text.contains(name);
    // A compiler warns of functions that nobody calls.
    let template = optional(TEMPLATE, "TANH", is_called("leg_tanhf("));
    let needs_expm1 = is_called("leg_tanhf(") || is_called("leg_expm1f(");
    let source = optional(&template, "EXPM1", needs_expm1)
        .replace("@TABLES@", tables.trim_end())
        .replace("@HIDDEN@", &hidden)
        .replace("@LAYERS@", calls.trim_end())
        .replace("@OUTPUT@", &output)
        .replace("@VECTORS@", &self_test(vectors));
    // The policy's own name comes last, so that it stays as it is.
    source
        .replace("leg_", &format!("{}_", prefix.0))
        .replace("LEG_", &format!("{}_", prefix.0.to_ascii_uppercase()))
        .replace("@ABOUT@", &about(policy))
}

/// Keeps the part of the source between `@NAME[@` and `@]NAME@`, or leaves it out.
fn optional(source: &str, name: &str, keep: bool) -> String {
    let (begin, end) = (format!("@{name}[@"), format!("@]{name}@"));
    let part = source.split_once(&begin).and_then(|(before, rest)| {
        rest.split_once(&end).map(|(part, after)| (before, part, after))
    });
    match part {
        Some((before, part, after)) => [before, if keep { part } else { "" }, after].concat(),
        None => source.to_owned(),
    }
}

/// Returns the lines of the comment that describes the policy.
fn about(policy: &Policy<'_>) -> String {
    let (m, p) = (policy.manifest(), &policy.manifest().provenance);
    let widths: Vec<String> = m.widths.iter().map(ToString::to_string).collect();
    format!(
        " * Policy  {} {}, CRC-32 {:08x}\n \
          * Made    by preset {}, seed {}, {} steps, trainer {}",
        plain(m.name),
        widths.join("-"),
        policy.crc32(),
        plain(p.preset),
        p.seed,
        p.steps,
        plain(p.trainer_version)
    )
}

/// Removes what ends a comment or starts a trigraph from a policy's name.
fn plain(text: &str) -> String {
    let fine = |c: char| c.is_ascii_alphanumeric() || " .,+-_".contains(c);
    text.chars().map(|c| if fine(c) { c } else { '_' }).collect()
}

fn table(name: &str, numbers: &[f32], in_a_group: usize) -> String {
    let mut text = format!("static const float {name}[{}] = {{\n", numbers.len());
    for group in numbers.chunks(in_a_group) {
        for line in group.chunks(6) {
            let line: Vec<String> = line.iter().map(|&x| hex(x)).collect();
            let _ = writeln!(text, "    {},", line.join(", "));
        }
    }
    text + "};\n"
}

fn self_test(vectors: &[TestVector]) -> String {
    let mut text = format!("#define LEG_TEST_VECTORS {}\n\n", vectors.len());
    text += "/* Observations with their actions. */\n";
    text += "static const float leg_test_vectors[LEG_TEST_VECTORS][5] = {\n";
    for TestVector { observation: o, action: a } in vectors {
        let row = [o.apex_vx_m_s, o.apex_y_m, o.density_ratio].map(hex);
        let action = [a.touchdown_angle_rad, a.elongation_speed_m_s].map(hex);
        let _ = writeln!(text, "    {{ {},\n      {} }},", row.join(", "), action.join(", "));
    }
    text + "};"
}

/// Formats a finite number as a hexadecimal constant of C99: exact, and the shortest such.
fn hex(x: f32) -> String {
    let bits = x.to_bits();
    let sign = if bits >> 31 == 1 { "-" } else { "" };
    // The 23 bits of the fraction are five digits and three quarters.
    let (fraction, exponent) = ((bits & 0x7f_ffff) << 1, (bits >> 23 & 0xff).cast_signed());
    let (whole, exponent) = match (exponent, fraction) {
        (0, 0) => (0, 0),
        (0, _) => (0, -126),
        _ => (1, exponent - 127),
    };
    let digits = format!("{fraction:06x}");
    let digits = digits.trim_end_matches('0');
    let point = if digits.is_empty() { "" } else { "." };
    format!("{sign}0x{whole}{point}{digits}p{exponent:+}f")
}

#[cfg(test)]
mod tests {
    use super::{hex, plain};

    #[test]
    fn hexadecimal_constants_are_exact() {
        for (x, text) in [
            (0.0, "0x0p+0f"),
            (-0.0, "-0x0p+0f"),
            (1.0, "0x1p+0f"),
            (-0.1, "-0x1.99999ap-4f"),
            (f32::MAX, "0x1.fffffep+127f"),
            (f32::MIN_POSITIVE, "0x1p-126f"),
            (f32::from_bits(1), "0x0.000002p-126f"),
            (std::f32::consts::LN_2, "0x1.62e43p-1f"),
        ] {
            assert_eq!(hex(x), text);
        }
    }

    #[test]
    fn a_policy_name_cannot_end_its_comment() {
        assert_eq!(plain("a*/b\n??/c\\"), "a__b____c_");
    }
}
