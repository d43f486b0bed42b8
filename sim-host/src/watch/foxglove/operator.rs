//! The parameters and services by which a viewer operates the leg. Requests wait for the leg's
//! answer in a thread of their own, as those of the keys do.

use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Receiver, Sender};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use foxglove::Schema;
use foxglove::websocket::service::{Handler, Request, Responder, Service, ServiceSchema};
use foxglove::websocket::{
    AnyClient, ChannelView, Client, GetParametersResponder, Parameter, ParameterHandler,
    ParameterValue, ServerListener, SetParametersResponder,
};
use leg_host::{Role, json_socket};
use leg_process::rounded;

use crate::operate::{LegRequest, LegStatus};
use crate::watch::scene::Scene;

/// The set-point, m/s; without a value that of the scenario.
const SET_POINT: &str = "set_point_m_s";
/// Whether the run is paused.
const PAUSED: &str = "paused";
/// Returns to the set-point of the scenario.
const RESET_SET_POINT: &str = "reset_set_point";
/// Ends the run.
const END_RUN: &str = "end_run";

/// Digits after the point of a set-point, so that one of 0.3 in f32 is shown as 0.3.
const DIGITS: usize = 6;
/// Longest wait for an answer of the leg.
const TIMEOUT: Duration = Duration::from_millis(500);
/// The JSON schema of an object without fields.
const EMPTY_OBJECT: &[u8] = br#"{"type":"object","properties":{}}"#;

/// The values of the parameters.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Values {
    set_point_m_s: Option<f64>,
    is_paused: Option<bool>,
}

impl Values {
    pub(super) fn of(scene: &Scene) -> Self {
        let ordered_m_s = scene.leg.as_ref().and_then(|leg| leg.ordered_m_s);
        let sent_m_s = scene.sample.map(|sample| rounded(sample.set_point_m_s.into(), DIGITS));
        Self {
            set_point_m_s: ordered_m_s.or(sent_m_s),
            is_paused: scene.leg.as_ref().map(|leg| leg.is_paused),
        }
    }

    fn after(request: &LegRequest, status: &LegStatus) -> Self {
        let set_point_m_s = match request {
            // Nobody knows that of the scenario before the next sample.
            LegRequest::SetPoint { m_s } => *m_s,
            _ => status.ordered_m_s,
        };
        Self { set_point_m_s, is_paused: Some(status.is_paused) }
    }

    /// Returns those that are known.
    pub(super) fn parameters(self) -> Vec<Parameter> {
        let set_point = self.set_point_m_s.map(|m_s| Parameter::float64(SET_POINT, m_s));
        let paused = self.is_paused.map(|is_paused| Parameter {
            name: PAUSED.to_owned(),
            r#type: None,
            value: Some(ParameterValue::Bool(is_paused)),
        });
        set_point.into_iter().chain(paused).collect()
    }
}

/// Requests of a viewer, and who waits for the result.
enum Order {
    Set { requests: Vec<LegRequest>, client: AnyClient, responder: SetParametersResponder },
    Call { request: LegRequest, responder: Responder },
}

/// Answers viewers.
pub(super) struct Operator {
    values: Mutex<Values>,
    /// Whether somebody has subscribed to a topic since this was taken.
    is_subscribed: AtomicBool,
    orders: Sender<Order>,
}

impl Operator {
    /// Begins with a thread that passes requests to the leg in `domain`.
    ///
    /// # Errors
    /// The error of the system if there can be no thread.
    pub(super) fn begin(domain: &str) -> io::Result<Arc<Self>> {
        let (orders, receiver) = mpsc::channel();
        let domain = domain.to_owned();
        std::thread::Builder::new()
            .name("operator".to_owned())
            .spawn(move || pass_on(&domain, &receiver))?;
        let (values, is_subscribed) = (Mutex::default(), AtomicBool::new(false));
        Ok(Arc::new(Self { values, is_subscribed, orders }))
    }

    /// Takes the values of the parameters; returns them if they have changed.
    pub(super) fn take(&self, new: Values) -> Option<Values> {
        let mut values = self.values.lock().unwrap_or_else(PoisonError::into_inner);
        (std::mem::replace(&mut *values, new) != new).then_some(new)
    }

    /// Returns whether somebody has subscribed to a topic since the last call.
    pub(super) fn take_subscribed(&self) -> bool {
        self.is_subscribed.swap(false, Ordering::Relaxed)
    }

    /// Returns the services.
    pub(super) fn services(&self) -> [Service; 2] {
        let service = |name: &str, request| {
            let empty = || Schema::new(name, "jsonschema", EMPTY_OBJECT);
            let schema = ServiceSchema::new(name)
                .with_request("json", empty())
                .with_response("json", empty());
            Service::builder(name, schema).handler(Call { request, orders: self.orders.clone() })
        };
        [
            service(RESET_SET_POINT, LegRequest::SetPoint { m_s: None }),
            service(END_RUN, LegRequest::Quit),
        ]
    }
}

/// A service that sends this request.
struct Call {
    request: LegRequest,
    orders: Sender<Order>,
}

impl Handler for Call {
    fn call(&self, _: Request, responder: Responder) {
        // An order that cannot be sent is dropped, and answered as an internal error.
        let _ = self.orders.send(Order::Call { request: self.request.clone(), responder });
    }
}

impl ServerListener for Operator {
    fn on_subscribe(&self, _: Client, _: ChannelView) {
        self.is_subscribed.store(true, Ordering::Relaxed);
    }
}

impl ParameterHandler for Operator {
    fn get(
        &self,
        _: AnyClient,
        names: Vec<String>,
        _: Option<String>,
        responder: GetParametersResponder,
    ) {
        let values = *self.values.lock().unwrap_or_else(PoisonError::into_inner);
        let mut parameters = values.parameters();
        parameters.retain(|parameter| names.is_empty() || names.contains(&parameter.name));
        responder.respond(parameters);
    }

    fn set(
        &self,
        client: AnyClient,
        parameters: Vec<Parameter>,
        _: Option<String>,
        responder: SetParametersResponder,
    ) {
        let mut requests = Vec::new();
        for parameter in &parameters {
            match request(parameter) {
                Ok(request) => requests.push(request),
                Err(why) => client.send_error(why),
            }
        }
        let _ = self.orders.send(Order::Set { requests, client, responder });
    }
}

/// Returns the request that sets a parameter, or why there is none.
fn request(parameter: &Parameter) -> Result<LegRequest, String> {
    match (parameter.name.as_str(), &parameter.value) {
        (SET_POINT, Some(ParameterValue::Float64(m_s))) => {
            Ok(LegRequest::SetPoint { m_s: Some(*m_s) })
        }
        (SET_POINT, Some(ParameterValue::Integer(m_s))) => {
            Ok(LegRequest::SetPoint { m_s: Some(*m_s as f64) })
        }
        (SET_POINT, None) => Ok(LegRequest::SetPoint { m_s: None }),
        (SET_POINT, Some(_)) => Err(format!("{SET_POINT} must be a number, in m/s")),
        (PAUSED, Some(ParameterValue::Bool(true))) => Ok(LegRequest::Pause),
        (PAUSED, Some(ParameterValue::Bool(false))) => Ok(LegRequest::Resume),
        (PAUSED, _) => Err(format!("{PAUSED} must be true or false")),
        (other, _) => {
            Err(format!("there is no parameter `{other}`: {SET_POINT} and {PAUSED} can be set"))
        }
    }
}

/// Passes requests to the leg until the server ends.
fn pass_on(domain: &str, orders: &Receiver<Order>) {
    let ask = |request: &LegRequest| {
        json_socket::ask::<_, LegStatus>(domain, Role::Leg, request, TIMEOUT)
            .map_err(|error| error.to_string())
    };
    while let Ok(order) = orders.recv() {
        match order {
            Order::Set { requests, client, responder } => {
                let mut applied = Vec::new();
                for request in &requests {
                    match ask(request) {
                        Ok(status) => {
                            let values = Values::after(request, &status);
                            let is_set_point = matches!(request, LegRequest::SetPoint { .. });
                            let name = if is_set_point { SET_POINT } else { PAUSED };
                            let is_it = |parameter: &Parameter| parameter.name == name;
                            applied.extend(values.parameters().into_iter().filter(is_it));
                        }
                        Err(why) => client.send_error(why),
                    }
                }
                responder.respond(applied);
            }
            Order::Call { request, responder } => {
                responder.respond(ask(&request).map(|_| "{}"));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parameters_become_requests_and_others_are_named() {
        let set =
            |name: &str, value| request(&Parameter { name: name.to_owned(), r#type: None, value });
        let m_s = |m_s| Ok(LegRequest::SetPoint { m_s });
        assert_eq!(set(SET_POINT, Some(ParameterValue::Integer(1))), m_s(Some(1.0)));
        assert_eq!(set(SET_POINT, Some(ParameterValue::Float64(-0.5))), m_s(Some(-0.5)));
        assert_eq!(set(SET_POINT, None), m_s(None));
        assert_eq!(set(PAUSED, Some(ParameterValue::Bool(true))), Ok(LegRequest::Pause));
        assert_eq!(set(PAUSED, Some(ParameterValue::Bool(false))), Ok(LegRequest::Resume));
        for (name, value, part) in [
            (SET_POINT, ParameterValue::String("fast".to_owned()), "a number"),
            (PAUSED, ParameterValue::Integer(1), "true or false"),
            ("speed", ParameterValue::Integer(1), "no parameter `speed`"),
        ] {
            let refused = set(name, Some(value)).unwrap_err();
            assert!(refused.contains(part), "{refused}");
        }
    }
}
