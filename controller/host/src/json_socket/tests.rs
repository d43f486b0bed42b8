use super::*;
use serde::Deserialize;

#[derive(Serialize, Deserialize)]
#[serde(tag = "request", rename_all = "kebab-case")]
enum Request {
    Status,
    Swap { file: String, blob: String },
}

const LONG: Duration = Duration::from_mins(1);

fn domain(dir: &tempfile::TempDir) -> Arc<Domain> {
    Domain::join_in(&dir.path().join("base"), "d").unwrap()
}

fn open_socket(domain: &Arc<Domain>) -> JsonSocket {
    JsonSocket::open(domain, Role::Controller, |request: Request| match request {
        Request::Swap { file, blob } => Ok(format!("{file}: {}", blob.len())),
        Request::Status => Err("not today".to_owned()),
    })
    .unwrap()
}

fn asked(domain: &Arc<Domain>, request: &Request) -> Result<String, AskError> {
    ask_at(domain.root(), domain.name(), Role::Controller, request, LONG)
}

/// Returns the answer to bytes that are no request.
fn raw(domain: &Arc<Domain>, bytes: &[u8]) -> String {
    let mut socket = UnixStream::connect(path(domain.root(), Role::Controller)).unwrap();
    let _ = socket.write_all(bytes);
    let mut answer = String::new();
    let _ = socket.read_to_string(&mut answer);
    answer
}

#[test]
fn answers_or_refuses_each_request() {
    let dir = tempfile::tempdir().unwrap();
    let domain = domain(&dir);
    let open = open_socket(&domain);
    let blob = "x".repeat(1 << 20);
    let swap = Request::Swap { file: "a.bin".into(), blob };
    assert_eq!(asked(&domain, &swap).unwrap(), "a.bin: 1048576");
    let refused = asked(&domain, &Request::Status).unwrap_err();
    assert!(matches!(&refused, AskError::Refused(why) if why == "not today"), "{refused}");
    drop(open);
    let nobody = asked(&domain, &Request::Status).unwrap_err();
    assert!(nobody.to_string().starts_with("no controller is running in domain `d`"), "{nobody}");
    let hint = crate::cli::hint::ask_error(&nobody).unwrap();
    assert!(hint.contains("controller --policy FILE --domain d"), "{hint}");
    assert!(!path(domain.root(), Role::Controller).exists());
}

#[test]
fn refuses_bytes_that_are_no_request_and_serves_the_next_client() {
    let dir = tempfile::tempdir().unwrap();
    let domain = domain(&dir);
    let _open = open_socket(&domain);
    for (bytes, part) in [
        (&b"\n"[..], "no request"),
        (b"{\"request\":\"fly\"}\n", "unknown variant `fly`"),
        (b"{\"request\":\"swap\",\"file\":\"a\"}\n", "missing field `blob`"),
        (b"\xff\xfe\n", "no request"),
        (&vec![b'x'; MAX_LINE + 4096], "longer than the limit of 4194304 bytes"),
    ] {
        let answer = raw(&domain, bytes);
        assert!(answer.contains(part) && answer.starts_with("{\"Err\""), "{part}: {answer}");
    }
    // A client that closes in the middle, and one that sends nothing.
    drop(UnixStream::connect(path(domain.root(), Role::Controller)).unwrap());
    let idle = UnixStream::connect(path(domain.root(), Role::Controller)).unwrap();
    // The idle one is left after a while, long before the next gives up.
    let answer = asked(&domain, &Request::Status);
    assert!(matches!(answer, Err(AskError::Refused(_))), "{answer:?}");
    drop(idle);
}

#[test]
fn a_dead_ones_socket_is_replaced_and_a_silent_one_is_told() {
    let dir = tempfile::tempdir().unwrap();
    let domain = domain(&dir);
    drop(UnixListener::bind(path(domain.root(), Role::Controller)).unwrap());
    let nobody = asked(&domain, &Request::Status);
    assert!(matches!(nobody, Err(AskError::Nobody { .. })), "{nobody:?}");
    let open = open_socket(&domain);
    assert!(matches!(asked(&domain, &Request::Status), Err(AskError::Refused(_))));
    drop(open);

    // As a stopped process: it listens, and nobody is at home.
    let _listener = UnixListener::bind(path(domain.root(), Role::Leg)).unwrap();
    let wait = Duration::from_millis(50);
    let silent: Result<String, _> = ask_at(domain.root(), "d", Role::Leg, &Request::Status, wait);
    assert!(matches!(silent, Err(AskError::Silent { role: Role::Leg, .. })), "{silent:?}");
}

#[test]
fn returns_the_answer_of_a_process_that_closes_before_it_has_read_the_request() {
    let dir = tempfile::tempdir().unwrap();
    let domain = domain(&dir);
    let listener = UnixListener::bind(path(domain.root(), Role::Controller)).unwrap();
    let server = std::thread::spawn(move || {
        let (mut socket, _) = listener.accept().unwrap();
        socket.write_all(b"{\"Err\":\"not so much\"}\n").unwrap();
    });
    // More than the socket holds, so that the write fails.
    let request = Request::Swap { file: "a.bin".into(), blob: "x".repeat(1 << 20) };
    let refused = asked(&domain, &request).unwrap_err();
    assert!(matches!(&refused, AskError::Refused(why) if why == "not so much"), "{refused}");
    server.join().unwrap();
}
