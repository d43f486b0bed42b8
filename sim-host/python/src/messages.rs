//! The classes `Sample` and `Command`: the messages between leg and controller.

use crate::convert::bad_value;
use bytemuck::Pod;
use leg_control::wire::{self, Header, SensorReadings, WIRE_VERSION, flags};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyType};

/// What the leg senses at a tick, and its set-point. A reading that is not sensed is `None`.
#[pyclass(frozen, module = "spring_leg")]
#[derive(Clone, Copy)]
pub(crate) struct Sample(pub(crate) wire::Sample);

/// What the leg does until the next tick, and what the controller found out.
#[pyclass(frozen, module = "spring_leg")]
#[derive(Clone, Copy)]
pub(crate) struct Command(pub(crate) wire::Command);

/// Returns a message of its bytes.
fn message<M: Pod>(what: &str, bytes: &[u8]) -> PyResult<M> {
    bytemuck::try_pod_read_unaligned(bytes).map_err(|_| {
        let (given, needed) = (bytes.len(), size_of::<M>());
        bad_value(format!("a {what} of {given} bytes; it has {needed}"))
    })
}

/// Returns what makes the message anew from its bytes.
fn reduced<'py>(
    message: &Bound<'py, PyAny>,
    bytes: &[u8],
) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyBytes>,))> {
    let bytes = PyBytes::new(message.py(), bytes);
    Ok((message.get_type().getattr("from_bytes")?, (bytes,)))
}

impl Sample {
    /// Returns a reading if its flags are set.
    fn sensed<T>(&self, flags: u16, reading: T) -> Option<T> {
        (self.0.header.flags & flags == flags).then_some(reading)
    }
}

#[pymethods]
impl Sample {
    /// Makes the sample of tick `seq`, `t_ns` after the start of the run.
    #[new]
    #[pyo3(signature = (seq, t_ns, *, run_id = 1, set_point_m_s = 0.0, vx_m_s = None, y_m = None,
        vy_m_s = None, contact = None, leg_length_m = None, leg_angle_rad = None,
        density_ratio = None, impulse = None, pitch_rad = None, pitch_rate_rad_s = None,
        velocity_m_s = None, velocity_age_ns = 0, height_m = None, height_age_ns = 0,
        pressure_pa = None, pressure_age_ns = 0))]
    #[expect(clippy::too_many_arguments, reason = "named in Python")]
    fn new(
        seq: u64,
        t_ns: u64,
        run_id: u32,
        set_point_m_s: f32,
        vx_m_s: Option<f32>,
        y_m: Option<f32>,
        vy_m_s: Option<f32>,
        contact: Option<bool>,
        leg_length_m: Option<f32>,
        leg_angle_rad: Option<f32>,
        density_ratio: Option<f32>,
        impulse: Option<[i32; 2]>,
        pitch_rad: Option<f32>,
        pitch_rate_rad_s: Option<f32>,
        velocity_m_s: Option<[f32; 2]>,
        velocity_age_ns: u32,
        height_m: Option<f32>,
        height_age_ns: u32,
        pressure_pa: Option<f32>,
        pressure_age_ns: u32,
    ) -> Self {
        let sensed = [
            (flags::CONTACT_SENSED, contact.is_some()),
            (flags::IN_CONTACT, contact == Some(true)),
            (flags::LEG_LENGTH_SENSED, leg_length_m.is_some()),
            (flags::DENSITY_SENSED, density_ratio.is_some()),
            (flags::VX_SENSED, vx_m_s.is_some()),
            (flags::Y_SENSED, y_m.is_some()),
            (flags::VY_SENSED, vy_m_s.is_some()),
            (flags::IMPULSE_SENSED, impulse.is_some()),
            (flags::PITCH_SENSED, pitch_rad.is_some()),
            (flags::PITCH_RATE_SENSED, pitch_rate_rad_s.is_some()),
            (flags::LEG_ANGLE_SENSED, leg_angle_rad.is_some()),
            (flags::VELOCITY_SENSED, velocity_m_s.is_some()),
            (flags::HEIGHT_SENSED, height_m.is_some()),
            (flags::PRESSURE_SENSED, pressure_pa.is_some()),
        ];
        let set = sensed.into_iter().filter(|(_, is_sensed)| *is_sensed);
        let flags = set.fold(0, |all, (flag, _)| all | flag);
        Self(wire::Sample {
            header: Header { version: WIRE_VERSION, flags, run_id, seq, t_ns },
            set_point_m_s,
            vx_m_s: vx_m_s.unwrap_or_default(),
            y_m: y_m.unwrap_or_default(),
            vy_m_s: vy_m_s.unwrap_or_default(),
            leg_length_m: leg_length_m.unwrap_or_default(),
            density_ratio: density_ratio.unwrap_or_default(),
            sensors: SensorReadings {
                pitch_rad: pitch_rad.unwrap_or_default(),
                pitch_rate_rad_s: pitch_rate_rad_s.unwrap_or_default(),
                leg_angle_rad: leg_angle_rad.unwrap_or_default(),
                impulse: impulse.unwrap_or_default(),
                velocity_m_s: velocity_m_s.unwrap_or_default(),
                height_m: height_m.unwrap_or_default(),
                pressure_pa: pressure_pa.unwrap_or_default(),
                velocity_age_ns,
                height_age_ns,
                pressure_age_ns,
            },
        })
    }

    /// Returns the sample of the bytes that go over shared memory.
    #[classmethod]
    fn from_bytes(_class: &Bound<'_, PyType>, data: &[u8]) -> PyResult<Self> {
        message("sample", data).map(Self)
    }

    fn __bytes__<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, bytemuck::bytes_of(&self.0))
    }

    fn __reduce__<'py>(
        slf: &Bound<'py, Self>,
    ) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyBytes>,))> {
        reduced(slf.as_any(), bytemuck::bytes_of(&slf.get().0))
    }

    fn __eq__(&self, other: &Self) -> bool {
        bytemuck::bytes_of(&self.0) == bytemuck::bytes_of(&other.0)
    }

    fn __repr__(&self) -> String {
        format!("{:?}", self.0)
    }

    #[getter]
    fn run_id(&self) -> u32 {
        self.0.header.run_id
    }

    #[getter]
    fn seq(&self) -> u64 {
        self.0.header.seq
    }

    #[getter]
    fn t_ns(&self) -> u64 {
        self.0.header.t_ns
    }

    /// Bits: see `leg_control::wire::flags`.
    #[getter]
    fn flags(&self) -> u16 {
        self.0.header.flags
    }

    #[getter]
    fn set_point_m_s(&self) -> f32 {
        self.0.set_point_m_s
    }

    #[getter]
    fn vx_m_s(&self) -> Option<f32> {
        self.sensed(flags::VX_SENSED, self.0.vx_m_s)
    }

    #[getter]
    fn y_m(&self) -> Option<f32> {
        self.sensed(flags::Y_SENSED, self.0.y_m)
    }

    #[getter]
    fn vy_m_s(&self) -> Option<f32> {
        self.sensed(flags::VY_SENSED, self.0.vy_m_s)
    }

    #[getter]
    fn contact(&self) -> Option<bool> {
        self.sensed(flags::CONTACT_SENSED, self.0.is_in_contact())
    }

    #[getter]
    fn leg_length_m(&self) -> Option<f32> {
        self.sensed(flags::LEG_LENGTH_SENSED, self.0.leg_length_m)
    }

    #[getter]
    fn leg_angle_rad(&self) -> Option<f32> {
        self.sensed(flags::LEG_ANGLE_SENSED, self.0.sensors.leg_angle_rad)
    }

    #[getter]
    fn density_ratio(&self) -> Option<f32> {
        self.sensed(flags::DENSITY_SENSED, self.0.density_ratio)
    }

    /// Integral of the specific force along the body's axes, in units of 2^-16 m/s; it wraps.
    #[getter]
    fn impulse(&self) -> Option<(i32, i32)> {
        self.sensed(flags::IMPULSE_SENSED, self.0.sensors.impulse.into())
    }

    #[getter]
    fn pitch_rad(&self) -> Option<f32> {
        self.sensed(flags::PITCH_SENSED, self.0.sensors.pitch_rad)
    }

    #[getter]
    fn pitch_rate_rad_s(&self) -> Option<f32> {
        self.sensed(flags::PITCH_RATE_SENSED, self.0.sensors.pitch_rate_rad_s)
    }

    #[getter]
    fn velocity_m_s(&self) -> Option<(f32, f32)> {
        self.sensed(flags::VELOCITY_SENSED, self.0.sensors.velocity_m_s.into())
    }

    #[getter]
    fn velocity_age_ns(&self) -> Option<u32> {
        self.sensed(flags::VELOCITY_SENSED, self.0.sensors.velocity_age_ns)
    }

    #[getter]
    fn height_m(&self) -> Option<f32> {
        self.sensed(flags::HEIGHT_SENSED, self.0.sensors.height_m)
    }

    #[getter]
    fn height_age_ns(&self) -> Option<u32> {
        self.sensed(flags::HEIGHT_SENSED, self.0.sensors.height_age_ns)
    }

    #[getter]
    fn pressure_pa(&self) -> Option<f32> {
        self.sensed(flags::PRESSURE_SENSED, self.0.sensors.pressure_pa)
    }

    #[getter]
    fn pressure_age_ns(&self) -> Option<u32> {
        self.sensed(flags::PRESSURE_SENSED, self.0.sensors.pressure_age_ns)
    }
}

#[pymethods]
impl Command {
    /// Makes the command that answers a sample.
    #[new]
    #[pyo3(signature = (sample, leg_angle_rad, elongation_m = 0.0, elongation_rate_m_s = 0.0))]
    fn new(
        sample: &Sample,
        leg_angle_rad: f32,
        elongation_m: f32,
        elongation_rate_m_s: f32,
    ) -> Self {
        Self(wire::Command {
            header: Header { version: WIRE_VERSION, flags: 0, ..sample.0.header },
            leg_angle_rad,
            elongation_m,
            elongation_rate_m_s,
            ..wire::Command::default()
        })
    }

    /// Returns the command of the bytes that go over shared memory.
    #[classmethod]
    fn from_bytes(_class: &Bound<'_, PyType>, data: &[u8]) -> PyResult<Self> {
        message("command", data).map(Self)
    }

    fn __bytes__<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, bytemuck::bytes_of(&self.0))
    }

    fn __reduce__<'py>(
        slf: &Bound<'py, Self>,
    ) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyBytes>,))> {
        reduced(slf.as_any(), bytemuck::bytes_of(&slf.get().0))
    }

    fn __eq__(&self, other: &Self) -> bool {
        bytemuck::bytes_of(&self.0) == bytemuck::bytes_of(&other.0)
    }

    fn __repr__(&self) -> String {
        format!("{:?}", self.0)
    }

    #[getter]
    fn run_id(&self) -> u32 {
        self.0.header.run_id
    }

    #[getter]
    fn seq(&self) -> u64 {
        self.0.header.seq
    }

    #[getter]
    fn t_ns(&self) -> u64 {
        self.0.header.t_ns
    }

    /// Whether this is the safe command: leg upright, no elongation.
    #[getter]
    fn is_safe(&self) -> bool {
        self.0.is_safe()
    }

    #[getter]
    fn leg_angle_rad(&self) -> f32 {
        self.0.leg_angle_rad
    }

    #[getter]
    fn elongation_m(&self) -> f32 {
        self.0.elongation_m
    }

    #[getter]
    fn elongation_rate_m_s(&self) -> f32 {
        self.0.elongation_rate_m_s
    }

    #[getter]
    fn apex_vx_m_s(&self) -> f32 {
        self.0.apex_vx_m_s
    }

    #[getter]
    fn apex_y_m(&self) -> f32 {
        self.0.apex_y_m
    }

    #[getter]
    fn density_ratio(&self) -> f32 {
        self.0.density_ratio
    }

    #[getter]
    fn velocity_offset_m_s(&self) -> f32 {
        self.0.velocity_offset_m_s
    }

    #[getter]
    fn apexes(&self) -> u32 {
        self.0.apexes
    }

    #[getter]
    fn rejected(&self) -> u32 {
        self.0.rejected
    }

    #[getter]
    fn set_points_refused(&self) -> u32 {
        self.0.set_points_refused
    }
}
