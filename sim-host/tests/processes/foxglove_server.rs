//! `sim-host watch --foxglove`: a client of Foxglove's protocol beside real runs.

use std::collections::BTreeMap;
use std::net::TcpStream;
use std::time::{Duration, Instant};

use foxglove::messages::{FrameTransform, SceneUpdate};
use prost::Message as _;
use rustix::process::Signal;
use serde_json::{Value, json};
use sim_host::record::schema::Sample;
use tungstenite::client::IntoClientRequest;
use tungstenite::{Message, WebSocket};

use crate::place::{LONG, Place, Running};

/// Starts the server at a free port.
fn serve(place: &Place) -> (Running, String) {
    let server = place.start("watch", &["--foxglove", "0", "--domain", place.domain()]);
    let url = server.wait_for_line(&format!("serving domain `{}` at ", place.domain()));
    (server, url)
}

/// A client of the protocol `foxglove.sdk.v1`.
struct Client {
    socket: WebSocket<TcpStream>,
    /// Numbers of the channels by topic, and of the services by name.
    channels: BTreeMap<String, u64>,
    services: BTreeMap<String, u32>,
    /// The topics by the number of their subscription.
    subscribed: Vec<&'static str>,
}

/// What a server sends.
enum Received {
    Text(Value),
    /// A message of a topic.
    Data(&'static str, Vec<u8>),
    Response(String),
}

impl Client {
    fn connect(url: &str) -> Self {
        let mut request = url.into_client_request().expect("a URL");
        let protocol = "foxglove.sdk.v1".parse().expect("a header");
        request.headers_mut().insert("Sec-WebSocket-Protocol", protocol);
        let stream = TcpStream::connect(url.trim_start_matches("ws://")).expect("a server");
        stream.set_read_timeout(Some(LONG)).expect("a limit");
        let (socket, _) = tungstenite::client(request, stream).expect("a handshake");
        let (channels, services) = (BTreeMap::new(), BTreeMap::new());
        let mut client = Self { socket, channels, services, subscribed: Vec::new() };
        while client.channels.is_empty() || client.services.is_empty() {
            let Received::Text(message) = client.receive() else { continue };
            for channel in message["channels"].as_array().into_iter().flatten() {
                let topic = channel["topic"].as_str().expect("a name").to_owned();
                assert_eq!(channel["encoding"], "protobuf", "{topic}");
                client.channels.insert(topic, channel["id"].as_u64().expect("a number"));
            }
            for service in message["services"].as_array().into_iter().flatten() {
                let name = service["name"].as_str().expect("a name").to_owned();
                client.services.insert(name, service["id"].as_u64().expect("a number") as u32);
            }
        }
        client
    }

    fn send(&mut self, message: &Value) {
        self.socket.send(Message::text(message.to_string())).expect("send");
    }

    fn subscribe(&mut self, topics: &[&'static str]) {
        self.subscribed = topics.to_vec();
        let subscriptions: Vec<_> = topics
            .iter()
            .enumerate()
            .map(|(id, topic)| json!({"id": id, "channelId": self.channels[*topic]}))
            .collect();
        self.send(&json!({"op": "subscribe", "subscriptions": subscriptions}));
    }

    fn set(&mut self, name: &str, value: impl Into<Value>) {
        let parameters = json!([{"name": name, "value": value.into()}]);
        self.send(&json!({"op": "setParameters", "id": name, "parameters": parameters}));
    }

    fn call(&mut self, service: &str) {
        let mut bytes = vec![2];
        for number in [self.services[service], 7, 4] {
            bytes.extend(number.to_le_bytes());
        }
        bytes.extend(b"json{}");
        self.socket.send(Message::binary(bytes)).expect("send");
    }

    fn receive(&mut self) -> Received {
        loop {
            match self.socket.read().expect("a message") {
                Message::Text(text) => {
                    return Received::Text(serde_json::from_str(&text).expect("JSON"));
                }
                Message::Binary(bytes) if bytes[0] == 1 => {
                    let id = u32::from_le_bytes(bytes[1..5].try_into().unwrap());
                    let data = bytes[13..].to_vec();
                    return Received::Data(self.subscribed[id as usize], data);
                }
                Message::Binary(bytes) if bytes[0] == 3 => {
                    return Received::Response(String::from_utf8_lossy(&bytes[13..]).into_owned());
                }
                _ => (),
            }
        }
    }

    /// Receives until `wanted` returns something.
    #[track_caller]
    fn wait_for<T>(&mut self, what: &str, mut wanted: impl FnMut(&Received) -> Option<T>) -> T {
        let since = Instant::now();
        loop {
            assert!(since.elapsed() < LONG, "{what} does not come");
            if let Some(found) = wanted(&self.receive()) {
                return found;
            }
        }
    }

    /// Waits until a parameter was set, and returns its value.
    #[track_caller]
    fn wait_for_value(&mut self, name: &str) -> Value {
        self.wait_for(name, |received| match received {
            Received::Text(message) if message["op"] == "parameterValues" => {
                let mut all = message["parameters"].as_array()?.iter();
                Some(all.find(|parameter| parameter["name"] == name)?["value"].clone())
            }
            _ => None,
        })
    }

    /// Waits for a text message with this operation.
    #[track_caller]
    fn wait_for_op(&mut self, op: &str) -> Value {
        self.wait_for(op, |received| match received {
            Received::Text(message) if message["op"] == op => Some(message.clone()),
            _ => None,
        })
    }
}

fn sample(received: &Received) -> Option<Sample> {
    match received {
        Received::Data("/sample", bytes) => Some(Sample::decode(&**bytes).expect("a sample")),
        _ => None,
    }
}

#[test]
fn a_client_of_foxglove_sees_the_leg_and_operates_it() {
    let place = Place::new();
    let (mut server, url) = serve(&place);
    assert!(url.starts_with("ws://127.0.0.1:"), "{url}");
    assert!(!place.root().exists(), "it does not create a domain without processes");
    let mut client = Client::connect(&url);
    client.subscribe(&["/sample", "/command", "/scene", "/tf", "/apex", "/policy", "/config"]);

    let own = ["--spawn", "--domain", place.domain(), "--set-point", "0.25"];
    let run = place.alone(&[&own[..], &["--duration", "80000"]].concat());
    let (mut seen, mut parents) = (BTreeMap::<_, u32>::new(), BTreeMap::new());
    client.wait_for("all that is drawn", |received| {
        let Received::Data(topic, bytes) = received else { return None };
        *seen.entry(*topic).or_default() += 1;
        if *topic == "/tf" {
            let frame = FrameTransform::decode(&**bytes).expect("a transform");
            parents.insert(frame.child_frame_id, frame.parent_frame_id);
        } else if *topic == "/scene" {
            let scene = SceneUpdate::decode(&**bytes).expect("a scene");
            for entity in scene.entities {
                seen.insert(if entity.id == "leg" { "the leg" } else { "the ground" }, 1);
            }
        }
        (seen.len() == 9 && parents.len() == 2).then_some(())
    });
    assert_eq!(parents["body"], "world");
    assert_eq!(parents["foot"], "body");

    client.wait_for("its set-point", |received| {
        sample(received).filter(|sample| sample.set_point_m_s == 0.25)
    });
    client.set("set_point_m_s", 0.75);
    assert_eq!(client.wait_for_value("set_point_m_s"), 0.75);
    client.wait_for("another set-point", |received| {
        sample(received).filter(|sample| sample.set_point_m_s == 0.75)
    });

    // Refused, with the reason.
    for (name, value, why) in [
        ("set_point_m_s", json!(99), "from -50 to 50"),
        ("paused", json!("yes"), "paused must be true or false"),
        ("speed", json!(1), "no parameter `speed`"),
    ] {
        client.set(name, value);
        let status = client.wait_for_op("status");
        assert!(status["message"].as_str().unwrap().contains(why), "{status}");
    }

    client.set("paused", true);
    assert_eq!(client.wait_for_value("paused"), true);
    let paused = place.leg_status();
    assert!(paused.is_paused);
    std::thread::sleep(Duration::from_millis(50));
    assert_eq!(place.leg_status().ticks, paused.ticks);
    // Who comes now sees the leg where it stands, and the values of the parameters.
    let mut late = Client::connect(&url);
    late.subscribe(&["/scene"]);
    let mut ids = Vec::new();
    late.wait_for("leg and ground", |received| {
        let Received::Data(_, bytes) = received else { return None };
        let scene = SceneUpdate::decode(&**bytes).expect("a scene");
        ids.extend(scene.entities.into_iter().map(|entity| entity.id));
        ["leg", "ground"].iter().all(|id| ids.iter().any(|seen| seen == id)).then_some(())
    });
    late.send(&json!({"op": "getParameters", "parameterNames": [], "id": "all"}));
    let values = late.wait_for_op("parameterValues");
    assert_eq!(values["parameters"][0]["value"], 0.75, "{values}");
    assert_eq!(values["parameters"][1], json!({"name": "paused", "value": true}), "{values}");
    client.set("paused", false);
    client.wait_for("a later tick", |received| {
        sample(received).filter(|sample| sample.seq > paused.seq + 1)
    });

    client.call("reset_set_point");
    let response = client.wait_for("a response", |received| match received {
        Received::Response(text) => Some(text.clone()),
        _ => None,
    });
    assert_eq!(response, "json{}");
    client.wait_for("its set-point again", |received| {
        sample(received).filter(|sample| sample.set_point_m_s == 0.25)
    });
    client.call("end_run");
    let run = run.end();
    assert!(run.assert_ok().out.starts_with("stopped after"), "{}", run.out);

    // The next run is shown by the same server, in real time, which cannot be paused.
    let own = ["--spawn", "--real-time", "--domain", place.domain(), "--set-point", "0.5"];
    let run = place.alone(&[&own[..], &["--duration", "80000"]].concat());
    client.wait_for("the next run", |received| {
        sample(received).filter(|sample| sample.set_point_m_s == 0.5)
    });
    client.set("paused", true);
    let status = client.wait_for_op("status");
    assert!(status["message"].as_str().unwrap().contains("its time does not wait"), "{status}");
    place.end_the_run();
    run.end().assert_ok();
    client.set("set_point_m_s", 0.5);
    let status = client.wait_for_op("status");
    assert!(status["message"].as_str().unwrap().contains("no simulator is running"), "{status}");

    server.signal(Signal::TERM);
    server.end().assert_ok();
    place.assert_clean();
}

#[test]
fn a_port_in_use_is_named_with_its_remedy() {
    let place = Place::new();
    let (_server, url) = serve(&place);
    let port = url.rsplit(':').next().unwrap();
    let second = place.start("watch", &["--foxglove", port]).end();
    second.assert(1, &[&format!("port {port} of 127.0.0.1 is in use"), "--foxglove 0"]);
    let elsewhere = ["--foxglove", "0", "--foxglove-host", "192.0.2.1"];
    place.start("watch", &elsewhere).end().assert(1, &["192.0.2.1:0", "--foxglove-host"]);
    place.start("watch", &["--foxglove", "0", "--domain", "a/b"]).end().assert(2, &["a/b"]);
    place.start("watch", &["--foxglove-host", "::1"]).end().assert(2, &["--foxglove"]);
}
