//! The page of a run in progress.

use crate::browser::{chromium, dom};
use serde_json::Value;
use sos_train::export::LogRecord;
use sos_train::live::{Live, LiveServer, LiveView, Wish};
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// The port in `http://127.0.0.1:PORT/`.
fn port(address: &str) -> u16 {
    let rest = address.strip_prefix("http://127.0.0.1:").unwrap();
    rest.trim_end_matches('/').parse().unwrap()
}

/// The answer's code and body.
fn ask(port: u16, method: &str, path: &str, headers: &[&str]) -> (u16, String) {
    let address = SocketAddr::from(([127, 0, 0, 1], port));
    let mut stream = TcpStream::connect(address).unwrap();
    stream
        .set_read_timeout(Some(Duration::from_secs(20)))
        .unwrap();
    let mut text =
        format!("{method} {path} HTTP/1.1\r\nConnection: close\r\nContent-Length: 0\r\n");
    if !headers.iter().any(|header| header.starts_with("Host:")) {
        text += &format!("Host: 127.0.0.1:{port}\r\n");
    }
    for header in headers {
        text += &format!("{header}\r\n");
    }
    stream.write_all((text + "\r\n").as_bytes()).unwrap();
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).unwrap();
    let answer = String::from_utf8_lossy(&answer).into_owned();
    let code = answer.split(' ').nth(1).unwrap().parse().unwrap();
    let body = answer.split_once("\r\n\r\n").map_or("", |(_, body)| body);
    (code, body.to_owned())
}

fn own(port: u16) -> String {
    format!("Origin: http://127.0.0.1:{port}")
}

/// A board as a run would have it, and its page.
fn served() -> (Arc<Live>, LiveServer, u16, Arc<AtomicBool>) {
    let interrupt = Arc::new(AtomicBool::new(false));
    let live = Arc::new(Live::new("runs/cat".to_owned(), Arc::clone(&interrupt)));
    let view = |i: usize| LiveView {
        name: format!("<b>{i}.jpg"),
        width: 640,
        height: 480,
        masked: i != 1,
    };
    live.introduce((0..9).map(view).collect(), 6000, Vec::new());
    live.stage("training", 100, 6000, Some("4 min left".to_owned()));
    live.note("the masks are white = object");
    for step in [50, 100] {
        live.record(&LogRecord {
            step,
            psnr: 20.0,
            samples_per_second: 1.2e6,
            alpha_change: Some(0.01),
            ..LogRecord::default()
        });
    }
    let server = LiveServer::start(Arc::clone(&live), None).unwrap();
    let at = port(&server.address());
    (live, server, at, interrupt)
}

#[test]
fn the_page_and_its_state_are_served() {
    let (_live, server, port, _) = served();
    let (code, page) = ask(port, "GET", "/", &[]);
    assert!(code == 200 && page.contains("page.js"), "{code} {page}");
    for path in ["/page.js", "/page.css", "/curves"] {
        assert_eq!(ask(port, "GET", path, &[]).0, 200, "{path}");
    }
    assert!(ask(port, "GET", "/curves", &[]).1.contains("<svg"));
    let (code, state) = ask(port, "GET", "/state?views=2,5,77,x", &[]);
    let state: Value = serde_json::from_str(&state).unwrap();
    assert_eq!(code, 200);
    assert_eq!(state["run"], "runs/cat");
    assert_eq!(state["stage"]["done"], 100);
    assert_eq!(state["wanted"], serde_json::json!([2, 5]));
    assert_eq!(state["views"].as_array().unwrap().len(), 9);
    assert_eq!(state["psnr"], 20.0);
    for path in ["/view/2.jpg", "/view/no.jpg", "/../etc/passwd", "/state/x"] {
        assert_eq!(ask(port, "GET", path, &[]).0, 404, "{path}");
    }
    assert_eq!(ask(port, "PUT", "/stop", &[&own(port)]).0, 405);
    server.stop();
    let begun = Instant::now();
    while TcpStream::connect(("127.0.0.1", port)).is_ok() {
        assert!(
            begun.elapsed() < Duration::from_secs(20),
            "it still listens"
        );
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// One who announces more than is sent keeps nobody else waiting.
#[test]
fn others_are_answered_while_one_holds_back() {
    let (_live, _server, port, _) = served();
    let mut silent = TcpStream::connect(("127.0.0.1", port)).unwrap();
    let text = format!(
        "POST /pause HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n{}\r\nContent-Length: 100000\r\n\r\nx",
        own(port)
    );
    silent.write_all(text.as_bytes()).unwrap();
    std::thread::sleep(Duration::from_millis(200));
    assert_eq!(ask(port, "GET", "/", &[]).0, 200);
    assert!(LiveServer::check(port).is_err());
}

#[test]
fn only_the_own_page_is_obeyed() {
    let (live, _server, port, interrupt) = served();
    let elsewhere = [
        "Origin: http://evil.example",
        "Origin: null",
        "Origin: https://127.0.0.1",
    ];
    for origin in elsewhere {
        for path in ["/stop", "/pause", "/finish"] {
            assert_eq!(ask(port, "POST", path, &[origin]).0, 403, "{origin} {path}");
        }
    }
    assert_eq!(ask(port, "POST", "/stop", &[]).0, 403, "no origin at all");
    let rebound = format!("Host: evil.example:{port}");
    let own = own(port);
    assert_eq!(ask(port, "POST", "/stop", &[&rebound, &own]).0, 403);
    assert_eq!(ask(port, "GET", "/state", &[&rebound]).0, 403);
    assert_eq!(live.wish(), Wish::GoOn);

    assert_eq!(
        ask(port, "GET", "/stop", &[]).0,
        404,
        "a GET changes nothing"
    );
    assert_eq!(
        ask(port, "POST", "/finish", &[&own]).0,
        409,
        "no object yet"
    );
    assert_eq!(ask(port, "POST", "/pause", &[&own]).0, 200);
    assert_eq!(live.wish(), Wish::Pause);
    assert_eq!(ask(port, "POST", "/go-on", &[&own]).0, 200);
    assert_eq!(live.wish(), Wish::GoOn);
    assert_eq!(ask(port, "POST", "/stop", &[&own]).0, 200);
    assert!(interrupt.load(Ordering::SeqCst));
}

#[test]
fn a_port_that_is_taken_is_refused_with_a_remedy() {
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port();
    let live = Arc::new(Live::new(String::new(), Arc::default()));
    let error = LiveServer::start(live, Some(port)).unwrap_err().to_string();
    assert!(
        error.contains(&port.to_string()) && error.contains("--view"),
        "{error}"
    );
}

#[test]
fn the_page_comes_alive_without_a_fault() {
    let Some(browser) = chromium() else { return };
    let (_live, server, _, _) = served();
    let dir = tempfile::tempdir().unwrap();
    let dom = dom(&browser, &server.address(), dir.path());
    assert!(dom.contains("data-ready=\"live\""), "{dom}");
    assert!(!dom.contains("data-errors"), "{dom}");
    for part in [
        "runs/cat",
        "4 min left",
        "&lt;b&gt;1.jpg (no mask)",
        "<svg",
        "1.2 M",
        "white = object",
    ] {
        assert!(dom.contains(part), "{part} is not in {dom}");
    }
}

/// A small run with a page, its address, and what it says after that.
fn train(dir: &std::path::Path, more: &[&str]) -> (Child, u16) {
    let mut run = Command::new(env!("CARGO_BIN_EXE_sos"))
        .args(["train", "--view", "--quiet", "--out", "run"])
        .args(more)
        .current_dir(dir)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(run.stderr.take().unwrap()).lines();
    let address = lines
        .by_ref()
        .map_while(Result::ok)
        .find_map(|line| line.strip_prefix("the run is shown at ").map(str::to_owned))
        .unwrap();
    // Somebody has to read on, or the run would wait.
    std::thread::spawn(move || lines.map_while(Result::ok).for_each(drop));
    (run, port(&address))
}

/// The state once it is as wanted.
fn wait(port: u16, wanted: impl Fn(&Value) -> bool) -> Value {
    let begun = Instant::now();
    loop {
        let state = ask(port, "GET", "/state?views=0,1", &[]).1;
        let state: Value = serde_json::from_str(&state).unwrap();
        if wanted(&state) {
            return state;
        }
        assert!(begun.elapsed() < Duration::from_secs(120), "{state}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn a_run_can_be_paused_stopped_and_finished_early() {
    let dir = tempfile::tempdir().unwrap();
    crate::fabricated::SCENE
        .write(&dir.path().join("scene"))
        .unwrap();
    let settings = [
        "steps=4000",
        "schedule.carve=0.02",
        "model.levels=5",
        "model.log2_table_size=12",
        "sampling.target_samples=2048",
        "sampling.occupancy_resolution=32",
        "export.mesh_resolution=48",
    ];
    let mut arguments = vec![
        "scene",
        "--masks",
        "scene/coarse_masks",
        "--preset",
        "quick",
    ];
    arguments.extend(settings.iter().flat_map(|setting| ["--set", setting]));
    let (mut run, port) = train(dir.path(), &arguments);
    let own = own(port);
    let state = wait(port, |state| state["pictures"]["1"].as_u64() > Some(0));
    assert_eq!(state["views"].as_array().unwrap().len(), 6);
    assert!(ask(port, "GET", "/view/1.jpg", &[]).1.contains("JFIF"));

    assert_eq!(ask(port, "POST", "/pause", &[&own]).0, 200);
    std::thread::sleep(Duration::from_millis(500));
    let step = wait(port, |_| true)["step"].clone();
    std::thread::sleep(Duration::from_millis(500));
    assert_eq!(
        wait(port, |_| true)["step"],
        step,
        "it goes on while paused"
    );
    assert_eq!(ask(port, "POST", "/stop", &[&own]).0, 200);
    assert_eq!(run.wait().unwrap().code(), Some(130));
    let folder = dir.path().join("run");
    assert!(folder.join("checkpoint").is_dir() && !folder.join("report.html").exists());

    let (mut run, port) = train(dir.path(), &["--resume"]);
    wait(port, |state| state["may_finish"] == true);
    let own = self::own(port);
    assert_eq!(ask(port, "POST", "/finish", &[&own]).0, 200);
    assert_eq!(run.wait().unwrap().code(), Some(0));
    let log = std::fs::read_to_string(folder.join("log.jsonl")).unwrap();
    assert!(
        log.contains("ended early, at step") && log.contains("\"event\":\"end\""),
        "{log}"
    );
    assert!(folder.join("report.html").is_file());
}
