//! The command `trainer inspect`.

use super::output::print;
use super::{Failure, failed, input};
use clap::Args;
use leg_control::actor::{Activations, OutputActivation};
use leg_control::policy::{FIRST_FORMAT_VERSION, Manifest, PREAMBLE_LEN, Policy, TestVector};
use leg_process::policy_file::PolicyFile;
use std::fmt::Write;
use std::path::PathBuf;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Policy file
    policy: PathBuf,
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let bytes = PolicyFile::read(&arguments.policy).map_err(input)?;
    let policy = bytes.policy().map_err(input)?;
    let vectors = test_vectors(&policy, bytes.as_slice()).map_err(failed)?;
    let text = describe(&policy, bytes.as_slice().len(), &vectors).map_err(failed)?;
    print(text.trim_end())
}

/// Returns the test vectors of a blob that has passed its checks, in the format of
/// [`leg_control::policy`].
pub(super) fn test_vectors(policy: &Policy<'_>, blob: &[u8]) -> postcard::Result<Vec<TestVector>> {
    let body = blob.get(PREAMBLE_LEN..).unwrap_or_default();
    let (_, mut rest) = postcard::take_from_bytes::<Manifest<'_>>(body)?;
    if policy.manifest().format_version() > FIRST_FORMAT_VERSION {
        (_, rest) = postcard::take_from_bytes::<Activations>(rest)?;
    }
    postcard::take_from_bytes(rest).map(|(vectors, _)| vectors)
}

fn describe(
    policy: &Policy<'_>,
    bytes: usize,
    vectors: &[TestVector],
) -> Result<String, std::fmt::Error> {
    let m = policy.manifest();
    let (o, a, l, p) = (&m.observation, &m.action, &m.leg, &m.provenance);
    let mut t = String::new();
    let widths: Vec<String> = m.widths.iter().map(ToString::to_string).collect();
    let weights = policy.actor().weights().len();
    writeln!(t, "name               {}", m.name)?;
    writeln!(t, "size               {bytes} bytes, CRC-32 {:08x}, checks passed", policy.crc32())?;
    writeln!(t, "format version     {}", m.format_version())?;
    let Activations { hidden, output } = m.activations;
    writeln!(
        t,
        "network            {} {hidden}, {output}; {weights} weights, f32",
        widths.join("-")
    )?;
    writeln!(t, "inputs             (observation - offset) * scale of vx m/s, y m, density ratio")?;
    writeln!(t, "  offset           {:?}", o.offset)?;
    writeln!(t, "  scale            {:?}", o.scale)?;
    let z = if output == OutputActivation::Tanh { "tanh" } else { "output" };
    writeln!(t, "actions            clip(offset + scale * {z}) for angle rad, elongation m/s")?;
    writeln!(t, "  offset           {:?}", a.offset)?;
    writeln!(t, "  scale            {:?}", a.scale)?;
    writeln!(t, "  low, high        {:?}, {:?}", a.low, a.high)?;
    writeln!(t, "leg                {} kg + {} kg added mass", l.mass_kg, l.added_mass_kg)?;
    writeln!(t, "  stiffness        {} N/m", l.stiffness_n_m)?;
    writeln!(t, "  volume           {} m3", l.volume_m3)?;
    writeln!(t, "  length           {} m + at most {} m", l.rest_length_m, l.max_elongation_m)?;
    writeln!(t, "  areas x, y       {} m2, {} m2", l.area_x_m2, l.area_y_m2)?;
    writeln!(t, "  drag x, y        {}, {}", l.drag_x, l.drag_y)?;
    writeln!(
        t,
        "trained in         density ratio {:?}, gravity {:?} m/s2",
        m.media.density_ratio, m.media.gravity_m_s2
    )?;
    writeln!(t, "preset             {}", p.preset)?;
    writeln!(t, "seed               {}", p.seed)?;
    writeln!(t, "steps              {}", p.steps)?;
    writeln!(t, "trainer            {}", p.trainer_version)?;
    writeln!(t, "cascade gains      density      kp      ki      kd  feed-fwd  limit m/s")?;
    for g in &m.gains {
        writeln!(
            t,
            "                   {:>7}  {:>6}  {:>6}  {:>6}  {:>8}  {:>9}",
            g.density_ratio, g.kp, g.ki, g.kd, g.feed_forward, g.limit_m_s
        )?;
    }
    writeln!(t, "test vectors       {}, passed; vx m/s, y m, rho: rad, m/s", vectors.len())?;
    for v in vectors {
        let (o, a) = (&v.observation, &v.action);
        writeln!(
            t,
            "                   {:>6}, {:>6}, {:>6}: {:>9}, {:>9}",
            o.apex_vx_m_s,
            o.apex_y_m,
            o.density_ratio,
            a.touchdown_angle_rad,
            a.elongation_speed_m_s
        )?;
    }
    writeln!(t, "configuration")?;
    for line in p.config.lines() {
        writeln!(t, "  {line}")?;
    }
    Ok(t)
}
