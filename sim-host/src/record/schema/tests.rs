use std::path::Path;

use prost_reflect::{DescriptorPool, DynamicMessage, Kind, MessageDescriptor, Value};

use super::*;

fn folder() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/src/record"))
}

fn compiled() -> Vec<u8> {
    let mut compiler = protox::Compiler::new([folder()]).unwrap();
    compiler.include_source_info(false).open_file("leg.proto").unwrap();
    compiler.encode_file_descriptor_set()
}

#[test]
fn the_descriptors_are_those_of_the_proto_file() {
    let again = "cargo test -p sim-host --lib descriptors -- --ignored";
    assert!(compiled() == DESCRIPTORS, "leg.proto has changed: {again} compiles it");
}

#[test]
#[ignore = "writes leg.fds from leg.proto"]
fn compile_the_descriptors() {
    std::fs::write(folder().join("leg.fds"), compiled()).unwrap();
}

/// `Name { field: value, … }` by the descriptors, in the words of `Debug`.
fn told(descriptor: &MessageDescriptor, bytes: &[u8]) -> String {
    let message = DynamicMessage::decode(descriptor.clone(), bytes).unwrap();
    let fields: Vec<String> = descriptor
        .fields()
        .map(|field| {
            assert!(field.is_list() || message.has_field(&field), "{}: unset", field.full_name());
            let value = match (&*message.get_field(&field), field.kind()) {
                (Value::EnumNumber(n), Kind::Enum(kind)) => {
                    kind.get_value(*n).unwrap().name().to_owned()
                }
                (Value::Bool(v), _) => format!("{v:?}"),
                (Value::U32(v), _) => format!("{v:?}"),
                (Value::U64(v), _) => format!("{v:?}"),
                (Value::I64(v), _) => format!("{v:?}"),
                (Value::F32(v), _) => format!("{v:?}"),
                (Value::F64(v), _) => format!("{v:?}"),
                (Value::String(v), _) => format!("{v:?}"),
                (Value::Bytes(v), _) => format!("{:?}", &v[..]),
                (Value::List(v), _) => {
                    format!("{:?}", v.iter().map(|v| v.as_str().unwrap()).collect::<Vec<_>>())
                }
                (other, kind) => panic!("{kind:?} {other:?}"),
            };
            format!("{}: {value}", field.name())
        })
        .collect();
    format!("{} {{ {} }}", descriptor.name(), fields.join(", "))
}

/// The same text whatever the writing of its names.
fn plain(text: &str) -> String {
    text.replace('_', "").to_lowercase()
}

#[track_caller]
fn assert_same<T: Recorded>(message: &T) {
    let pool = DescriptorPool::decode(DESCRIPTORS).unwrap();
    let descriptor = pool.get_message_by_name(T::CHANNEL.schema()).unwrap();
    let bytes = message.encode_to_vec();
    assert_eq!(plain(&format!("{message:?}")), plain(&told(&descriptor, &bytes)));
    assert_eq!(format!("{:?}", T::decode(&*bytes).unwrap()), format!("{message:?}"));
}

/// Each field with a value of its own.
fn command() -> wire::Command {
    wire::Command {
        header: header(1, 2, 3, u64::MAX, 5),
        leg_angle_rad: 6.5,
        elongation_m: -7.5,
        elongation_rate_m_s: 8.5,
        apex_vx_m_s: 9.5,
        apex_y_m: 10.5,
        density_ratio: 11.5,
        velocity_offset_m_s: 12.5,
        apexes: 13,
        rejected: 14,
        reserved: 15,
    }
}

fn sample() -> wire::Sample {
    wire::Sample {
        header: header(1, 2, 3, 4, u64::MAX),
        set_point_m_s: 6.5,
        vx_m_s: f32::MIN_POSITIVE,
        y_m: 8.5,
        vy_m_s: f32::INFINITY,
        leg_length_m: 10.5,
        density_ratio: 11.5,
    }
}

#[test]
fn structs_and_proto_file_say_the_same() {
    assert_same(&Sample::from(&sample()));
    assert_same(&Command::over(16, &command(), true, 18));
    assert_same(&State {
        seq: 1,
        x_m: 2.5,
        vx_m_s: 3.5,
        y_m: 4.5,
        vy_m_s: 5.5,
        phase: Phase::Stance.into(),
        foot_x_m: 7.5,
        foot_y_m: 8.5,
        density_ratio: 9.5,
    });
    assert_same(&Apex {
        seq: 1,
        t_s: 2.5,
        x_m: 3.5,
        y_m: 4.5,
        vx_m_s: 5.5,
        set_point_m_s: 6.5,
        density_ratio: 7.5,
        answered: true,
        density_estimate: 9.5,
        seen_vx_m_s: 10.5,
        velocity_offset_m_s: 11.5,
    });
    for kind in [EventKind::Touchdown, EventKind::LiftOff, EventKind::Fall] {
        assert_same(&Event {
            seq: 1,
            t_s: 2.5,
            kind: kind.into(),
            x_m: 4.5,
            vx_m_s: 5.5,
            y_m: 6.5,
            vy_m_s: 7.5,
            foot_x_m: 8.5,
            foot_y_m: 9.5,
        });
    }
    assert_same(&Policy { name: "p".into(), crc32: 2, blob: vec![0, 3], run_id: 4, seq: 5 });
    assert_same(&Config {
        scenario_toml: "a = 1\n".into(),
        sim_host_version: "0".into(),
        wire_version: 3,
        rate_hz: 4,
        gravity_m_s2: 5.5,
        pace: "lock-step".into(),
        command_line: vec!["sim-host".into(), "run".into()],
        started_unix_ns: 8,
    });
    assert_same(&Loop {
        seq: 1,
        lateness_ns: -2,
        tick_ns: 3,
        sample_age_ns: 4,
        round_trip_ns: 5,
        flags: 6,
    });
    assert_same(&End { ending: "fall".into(), ticks: 2, state_hash: "3".into(), dropped: 4 });
}

#[test]
fn every_bit_of_a_message_survives() {
    let bits = [0x8000_0000, 0x7fc0_0001, 0xffa1_2345, 0x7f80_0000, 1];
    for bits in bits {
        let x = f32::from_bits(bits);
        let sample = wire::Sample { vx_m_s: x, density_ratio: x, ..sample() };
        let read = Sample::decode(&*Sample::from(&sample).encode_to_vec()).unwrap();
        let read = wire::Sample::from(&read);
        assert_eq!(read.vx_m_s.to_bits(), bits);
        assert_eq!(read.density_ratio.to_bits(), bits);
        assert_eq!(read.header, sample.header);
    }
    let recorded = Command::over(9, &command(), false, 0);
    let read = Command::decode(&*recorded.encode_to_vec()).unwrap();
    assert_eq!(wire::Command::from(&read), command());
}

#[test]
fn channels_are_numbered_in_order() {
    let pool = DescriptorPool::decode(DESCRIPTORS).unwrap();
    for (number, channel) in Channel::ALL.into_iter().enumerate() {
        assert_eq!(channel as usize, number);
        assert!(pool.get_message_by_name(channel.schema()).is_some(), "{channel:?}");
    }
}
