//! Shapes of Foxglove's message types: x forwards, y into the picture, z upwards, in m.

use foxglove::messages::packed_element_field::NumericType;
use foxglove::messages::{
    Color, LinePrimitive, PackedElementField, Point3, PointCloud, Pose, Quaternion, SceneEntity,
    SpherePrimitive, Timestamp, TriangleListPrimitive, Vector3,
};

/// The frame of everything that is drawn.
pub(super) const WORLD: &str = "world";
/// Half of the depth of ground and water, m.
const HALF_DEPTH_M: f64 = 1.0;
/// Bytes of a point: three coordinates of four bytes, and a colour.
const POINT_LEN: u32 = 16;

/// A place in the plane of the motion: x, and height, m.
pub(super) type Place = [f64; 2];

/// A colour: red, green, blue, alpha.
pub(super) type Rgba = [u8; 4];

pub(super) fn timestamp(time_ns: u64) -> Option<Timestamp> {
    let (sec, nsec) = (time_ns / 1_000_000_000, time_ns % 1_000_000_000);
    Timestamp::new_checked(u32::try_from(sec).unwrap_or(u32::MAX), nsec as u32)
}

pub(super) fn vector([x, z]: Place) -> Vector3 {
    Vector3 { x, y: 0.0, z }
}

/// Returns no rotation.
pub(super) fn upright() -> Quaternion {
    Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 }
}

fn color(rgba: Rgba) -> Color {
    let [r, g, b, a] = rgba.map(|part| f64::from(part) / 255.0);
    Color { r, g, b, a }
}

fn point([x, z]: Place, y: f64) -> Point3 {
    Point3 { x, y, z }
}

/// Returns an entity without any shape; it replaces the one of the same name.
pub(super) fn entity(id: &str, time_ns: u64) -> SceneEntity {
    let (timestamp, frame_id, id) = (timestamp(time_ns), WORLD.to_owned(), id.to_owned());
    SceneEntity { timestamp, frame_id, id, ..SceneEntity::default() }
}

pub(super) fn sphere(at: Place, diameter_m: f64, rgba: Rgba) -> SpherePrimitive {
    SpherePrimitive {
        pose: Some(Pose { position: Some(vector(at)), orientation: Some(upright()) }),
        size: Some(Vector3 { x: diameter_m, y: diameter_m, z: diameter_m }),
        color: Some(color(rgba)),
    }
}

pub(super) fn line(points: &[Place], thickness: f64, rgba: Rgba) -> LinePrimitive {
    LinePrimitive {
        thickness,
        points: points.iter().map(|at| point(*at, 0.0)).collect(),
        color: Some(color(rgba)),
        ..LinePrimitive::default()
    }
}

/// Returns a surface of constant depth over the places.
pub(super) fn surface(places: &[Place], rgba: Rgba) -> TriangleListPrimitive {
    let edges = places.iter().flat_map(|at| [-HALF_DEPTH_M, HALF_DEPTH_M].map(|y| point(*at, y)));
    let quads = (0..places.len().saturating_sub(1) as u32).map(|i| 2 * i);
    TriangleListPrimitive {
        points: edges.collect(),
        color: Some(color(rgba)),
        indices: quads.flat_map(|i| [i, i + 1, i + 2, i + 2, i + 1, i + 3]).collect(),
        ..TriangleListPrimitive::default()
    }
}

/// Returns a cloud of points, each with its colour.
pub(super) fn points(all: &[(Place, Rgba)], time_ns: u64) -> PointCloud {
    let field = |name: &str, offset, kind: NumericType| PackedElementField {
        name: name.to_owned(),
        offset,
        r#type: kind.into(),
    };
    let mut fields: Vec<_> = (0..)
        .step_by(4)
        .zip(["x", "y", "z"])
        .map(|(o, n)| field(n, o, NumericType::Float32))
        .collect();
    let channels = (12..).zip(["red", "green", "blue", "alpha"]);
    fields.extend(channels.map(|(offset, name)| field(name, offset, NumericType::Uint8)));
    let mut data = Vec::with_capacity(all.len() * POINT_LEN as usize);
    for ([x, z], rgba) in all {
        for coordinate in [*x as f32, 0.0, *z as f32] {
            data.extend(coordinate.to_le_bytes());
        }
        data.extend(rgba);
    }
    PointCloud {
        timestamp: timestamp(time_ns),
        frame_id: WORLD.to_owned(),
        pose: Some(Pose { position: Some(vector([0.0; 2])), orientation: Some(upright()) }),
        point_stride: POINT_LEN,
        fields,
        data: data.into(),
    }
}
