//! The messages in shared memory byte by byte, and the attributes of their services: what a
//! program in another language needs to know.

use std::mem::{align_of, offset_of};

use leg_control::wire::{Command, Sample, flags};
use serde::Serialize;

use super::payload::Message;
use super::service::{Attributes, attributes};

/// A field of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Field {
    /// Bytes before it.
    pub offset: usize,
    /// Its type, as Rust writes it.
    #[serde(rename = "type")]
    pub kind: &'static str,
    /// Its name, with that of the struct that contains it.
    pub name: &'static str,
}

/// The fields of a message, without gaps; the compiler checks their types.
macro_rules! fields {
    ($message:ty: $($($part:ident).+: $kind:ty),+ $(,)?) => {
        &[$({
            let _: fn(&$message) -> &$kind = |message| &message.$($part).+;
            Field {
                offset: offset_of!($message, $($part).+),
                kind: stringify!($kind),
                name: stringify!($($part).+),
            }
        }),+]
    };
}

const SAMPLE: &[Field] = fields!(Sample:
    header.version: u16,
    header.flags: u16,
    header.run_id: u32,
    header.seq: u64,
    header.t_ns: u64,
    set_point_m_s: f32,
    vx_m_s: f32,
    y_m: f32,
    vy_m_s: f32,
    leg_length_m: f32,
    density_ratio: f32,
    sensors.pitch_rad: f32,
    sensors.pitch_rate_rad_s: f32,
    sensors.leg_angle_rad: f32,
    sensors.impulse: [i32; 2],
    sensors.velocity_m_s: [f32; 2],
    sensors.height_m: f32,
    sensors.pressure_pa: f32,
    sensors.velocity_age_ns: u32,
    sensors.height_age_ns: u32,
    sensors.pressure_age_ns: u32,
);

const COMMAND: &[Field] = fields!(Command:
    header.version: u16,
    header.flags: u16,
    header.run_id: u32,
    header.seq: u64,
    header.t_ns: u64,
    leg_angle_rad: f32,
    elongation_m: f32,
    elongation_rate_m_s: f32,
    apex_vx_m_s: f32,
    apex_y_m: f32,
    density_ratio: f32,
    velocity_offset_m_s: f32,
    apexes: u32,
    rejected: u32,
    set_points_refused: u32,
);

/// The flags of a header by bit.
pub const FLAGS: [(&str, u16); 16] = [
    ("CONTACT_SENSED", flags::CONTACT_SENSED),
    ("IN_CONTACT", flags::IN_CONTACT),
    ("LEG_LENGTH_SENSED", flags::LEG_LENGTH_SENSED),
    ("DENSITY_SENSED", flags::DENSITY_SENSED),
    ("END", flags::END),
    ("VX_SENSED", flags::VX_SENSED),
    ("Y_SENSED", flags::Y_SENSED),
    ("VY_SENSED", flags::VY_SENSED),
    ("SAFE", flags::SAFE),
    ("IMPULSE_SENSED", flags::IMPULSE_SENSED),
    ("PITCH_SENSED", flags::PITCH_SENSED),
    ("LEG_ANGLE_SENSED", flags::LEG_ANGLE_SENSED),
    ("VELOCITY_SENSED", flags::VELOCITY_SENSED),
    ("HEIGHT_SENSED", flags::HEIGHT_SENSED),
    ("PRESSURE_SENSED", flags::PRESSURE_SENSED),
    ("PITCH_RATE_SENSED", flags::PITCH_RATE_SENSED),
];

/// A service, its message, and who sends it.
#[derive(Clone, Debug, Serialize)]
pub struct ServiceLayout {
    /// Name of the service.
    pub name: &'static str,
    /// Role of the sender.
    pub sender: &'static str,
    /// Name of the payload type.
    pub payload_type: &'static str,
    /// Size of a message.
    pub bytes: usize,
    /// Alignment of a message.
    pub alignment: usize,
    /// Attributes with which the controller creates it.
    pub attributes: Attributes,
    /// The fields of a message, in their order.
    pub fields: &'static [Field],
}

/// Returns both services.
#[must_use]
pub fn services() -> [ServiceLayout; 2] {
    [of::<Sample>(SAMPLE), of::<Command>(COMMAND)]
}

fn of<M: Message>(fields: &'static [Field]) -> ServiceLayout {
    ServiceLayout {
        name: M::SERVICE,
        sender: M::SENDER.as_str(),
        payload_type: M::TYPE_NAME,
        bytes: size_of::<M>(),
        alignment: align_of::<M>(),
        attributes: attributes(),
        fields,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shm::hello::SESSION_VERSION;

    const DOCUMENT: &str = include_str!("../../SESSION.md");

    /// Returns the cells of the first table after a text, without its head.
    fn table(after: &str) -> Vec<Vec<String>> {
        let (_, rest) = DOCUMENT.split_once(after).expect(after);
        let rest = rest.split_once("\n|").expect("a table").1;
        rest.lines()
            .skip(2)
            .take_while(|line| line.starts_with('|'))
            .map(|row| {
                let cells = row.trim_matches('|').split('|');
                cells.map(|cell| cell.trim().trim_matches('`').to_owned()).collect()
            })
            .collect()
    }

    #[test]
    fn the_fields_fill_each_message() {
        for service in services() {
            let mut end = 0;
            for field in service.fields {
                assert_eq!(field.offset, end, "{field:?}");
                end += match field.kind {
                    "u16" => 2,
                    "u32" | "f32" => 4,
                    "u64" | "[i32; 2]" | "[f32; 2]" => 8,
                    other => panic!("{other}"),
                };
            }
            assert_eq!(end, service.bytes);
        }
    }

    #[test]
    fn the_document_has_the_services_and_messages_byte_by_byte() {
        let in_document = table("There are two publish-subscribe services");
        for (row, service) in in_document.iter().zip(services()) {
            let (bytes, alignment) = (service.bytes.to_string(), service.alignment.to_string());
            let expected = [service.name, service.payload_type, &bytes, &alignment, service.sender];
            assert_eq!(row, &expected);
            let fields = table(&format!("### `{}`", service.payload_type));
            assert_eq!(fields.len(), service.fields.len());
            for (row, field) in fields.iter().zip(service.fields) {
                let expected = [&field.offset.to_string(), field.kind, field.name];
                assert_eq!(row[..3], expected, "{row:?}");
            }
        }
        assert_eq!(in_document.len(), 2);
    }

    #[test]
    fn the_document_has_the_attributes_the_flags_and_the_version() {
        let attributes = serde_json::to_value(attributes()).unwrap();
        let attributes = attributes.as_object().unwrap();
        let rows = table("creates both with these attributes");
        assert_eq!(rows.len(), attributes.len());
        for row in rows {
            assert_eq!(attributes[&row[0]].to_string(), row[1], "{row:?}");
        }
        let flags = table("### Flags");
        assert_eq!(flags.len(), FLAGS.len());
        for (bit, (row, (name, flag))) in flags.iter().zip(FLAGS).enumerate() {
            assert_eq!((&row[0], &row[1][..]), (&bit.to_string(), name));
            assert_eq!(1 << bit, flag, "{name}");
        }
        let is_current = format!("\nVersion {SESSION_VERSION}. The table");
        assert!(DOCUMENT.contains(&is_current));
        assert_eq!(table("## Versions").last().unwrap()[0], SESSION_VERSION.to_string());
    }
}
