//! The page, over HTTP on the loopback address.

use super::{Live, Wish};
use crate::report::STYLE;
use std::io;
use std::net::{Ipv4Addr, SocketAddr, TcpListener};
use std::sync::Arc;
use std::thread::JoinHandle;
use tiny_http::{Header, Method, Request, Response, Server};

/// Where the page is, unless that port is taken or another one is asked for.
const USUAL_PORT: u16 = 8420;
const PAGE: &str = include_str!("page.html");
const SCRIPT: &str = include_str!("page.js");
const PAGE_STYLE: &str = include_str!("page.css");
/// Nothing from elsewhere, and nowhere else to be shown in.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; \
                      img-src 'self'; connect-src 'self'; frame-ancestors 'none'; base-uri 'none'; \
                      form-action 'none'";

/// Why a page cannot be served.
#[derive(Debug, thiserror::Error)]
pub enum LiveError {
    /// The port is taken, or not for everyone.
    #[error(
        "cannot show the run at port {port} of this machine: {reason}; choose another one with --view=PORT, or any with --view"
    )]
    Port {
        /// What was asked for.
        port: u16,
        /// What the system said.
        reason: String,
    },
    /// The system allows no thread.
    #[error("cannot start the page's thread: {0}; go on without --view")]
    Thread(#[from] io::Error),
}

/// A server of one run's page; it ends when this is dropped.
#[derive(Debug)]
pub struct LiveServer {
    port: u16,
    handle: Handle,
}

/// Ends the server's thread.
struct Handle {
    server: Arc<Server>,
    thread: Option<JoinHandle<()>>,
}

impl std::fmt::Debug for Handle {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Handle")
    }
}

impl Drop for Handle {
    fn drop(&mut self) {
        self.server.unblock();
        if let Some(thread) = self.thread.take() {
            // A thread that failed has nothing more to say.
            let _ = thread.join();
        }
    }
}

impl LiveServer {
    /// Serves `live` at a port of 127.0.0.1; `None` for the usual one, or any that is free.
    ///
    /// # Errors
    /// [`LiveError`] if a port that was asked for cannot be had, or no port at all.
    pub fn start(live: Arc<Live>, port: Option<u16>) -> Result<Self, LiveError> {
        let open = |port: u16| {
            Server::http(SocketAddr::from((Ipv4Addr::LOCALHOST, port))).map_err(|e| {
                LiveError::Port {
                    port,
                    reason: e.to_string(),
                }
            })
        };
        let server = Arc::new(match port {
            Some(port) => open(port)?,
            None => open(USUAL_PORT).or_else(|_| open(0))?,
        });
        let port = server
            .server_addr()
            .to_ip()
            .map_or(0, |address| address.port());
        let serving = Arc::clone(&server);
        let thread = std::thread::Builder::new()
            .name("live view".to_owned())
            .spawn(move || {
                for request in serving.incoming_requests() {
                    let live = Arc::clone(&live);
                    // Each by itself: one that announces more than it sends is waited for when it is dropped.
                    // Where the system has no thread to give, the page asks again.
                    let _ = std::thread::Builder::new()
                        .name("live view, answer".to_owned())
                        .spawn(move || answer(&live, request));
                }
            })?;
        Ok(Self {
            port,
            handle: Handle {
                server,
                thread: Some(thread),
            },
        })
    }

    /// Whether a port that is asked for can be had, for whoever has much to do before it is needed.
    ///
    /// # Errors
    /// [`LiveError::Port`] if not.
    pub fn check(port: u16) -> Result<(), LiveError> {
        let address = SocketAddr::from((Ipv4Addr::LOCALHOST, port));
        match TcpListener::bind(address) {
            Ok(_) => Ok(()),
            Err(error) => Err(LiveError::Port {
                port,
                reason: error.to_string(),
            }),
        }
    }

    /// Where the page is.
    #[must_use]
    pub fn address(&self) -> String {
        format!("http://127.0.0.1:{}/", self.port)
    }

    /// Ends the server now.
    pub fn stop(self) {
        drop(self.handle);
    }
}

/// What is sent back.
struct Answer {
    code: u16,
    kind: &'static str,
    body: Vec<u8>,
}

impl Answer {
    fn of(kind: &'static str, body: impl Into<Vec<u8>>) -> Self {
        Self {
            code: 200,
            kind,
            body: body.into(),
        }
    }

    fn refusal(code: u16, why: &str) -> Self {
        Self {
            code,
            kind: "text/plain; charset=utf-8",
            body: format!("{why}\n").into_bytes(),
        }
    }
}

fn answer(live: &Live, request: Request) {
    let header = |name: &str| {
        let found = request
            .headers()
            .iter()
            .find(|header| header.field.as_str().as_str().eq_ignore_ascii_case(name));
        found.map(|header| header.value.as_str())
    };
    let answer = if !is_own_host(header("Host")) {
        Answer::refusal(403, "this page is for 127.0.0.1 alone")
    } else {
        match request.method() {
            Method::Get => get(live, request.url()),
            Method::Post if is_own_origin(header("Origin"), header("Host")) => {
                post(live, request.url())
            }
            Method::Post => Answer::refusal(403, "only the run's own page may ask for that"),
            _ => Answer::refusal(405, "GET and POST are understood"),
        }
    };
    let mut response = Response::from_data(answer.body).with_status_code(answer.code);
    for (name, value) in [
        ("Content-Type", answer.kind),
        ("Content-Security-Policy", POLICY),
        ("X-Content-Type-Options", "nosniff"),
        ("Cache-Control", "no-store"),
    ] {
        if let Ok(header) = Header::from_bytes(name, value) {
            response.add_header(header);
        }
    }
    // Who has gone needs no answer.
    let _ = request.respond(response);
}

/// Whether a request names this machine as itself: a page elsewhere whose name was made to lead here cannot. The port may be
/// another one, at which a tunnel leads here.
fn is_own_host(host: Option<&str>) -> bool {
    // Browsers leave a port of 80 out.
    host.map(|host| host.rsplit_once(':').unwrap_or((host, "80")))
        .is_some_and(|(name, at)| {
            ["127.0.0.1", "localhost"].contains(&name.to_ascii_lowercase().as_str())
                && at.parse::<u16>().is_ok()
        })
}

/// Whether a request comes from the page that this server gave: from the host that is asked.
fn is_own_origin(origin: Option<&str>, host: Option<&str>) -> bool {
    is_own_host(host)
        && origin
            .and_then(|origin| origin.strip_prefix("http://"))
            .zip(host)
            .is_some_and(|(origin, host)| origin.eq_ignore_ascii_case(host))
}

fn get(live: &Live, url: &str) -> Answer {
    let (path, query) = url.split_once('?').unwrap_or((url, ""));
    match path {
        "/" => Answer::of("text/html; charset=utf-8", PAGE),
        "/page.js" => Answer::of("text/javascript; charset=utf-8", SCRIPT),
        "/page.css" => Answer::of("text/css; charset=utf-8", format!("{STYLE}\n{PAGE_STYLE}")),
        "/state" => {
            let views: Vec<usize> = query
                .strip_prefix("views=")
                .unwrap_or_default()
                .split(',')
                .filter_map(|number| number.parse().ok())
                .collect();
            Answer::of("application/json", live.look(&views).to_string())
        }
        "/curves" => Answer::of("text/html; charset=utf-8", live.curves()),
        _ => {
            let view = path
                .strip_prefix("/view/")
                .and_then(|name| name.strip_suffix(".jpg"))
                .and_then(|number| number.parse().ok());
            match view.and_then(|view| live.picture(view)) {
                Some(jpeg) => Answer::of("image/jpeg", jpeg.as_slice()),
                None => Answer::refusal(404, "there is no such page"),
            }
        }
    }
}

fn post(live: &Live, url: &str) -> Answer {
    let wish = match url {
        "/pause" => Wish::Pause,
        "/go-on" => Wish::GoOn,
        "/stop" => Wish::Stop,
        "/finish" => Wish::Finish,
        _ => return Answer::refusal(404, "pause, go-on, stop and finish can be asked for"),
    };
    if live.ask(wish) {
        Answer::of("text/plain; charset=utf-8", "done\n")
    } else {
        Answer::refusal(409, "there is no object yet that final pictures could show")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_this_machine_is_a_host() {
        // Also those of a tunnel, and one of which browsers leave 80 out.
        for host in [
            "127.0.0.1:8420",
            "LOCALHOST:8420",
            "localhost:9000",
            "localhost",
        ] {
            assert!(is_own_host(Some(host)), "{host}");
            let origin = format!("http://{host}");
            assert!(is_own_origin(Some(&origin), Some(host)), "{host}");
        }
        for host in [
            "evil.example:8420",
            "127.0.0.1:99999",
            "localhost.evil.example:8420",
            "127.0.0.1:8420.evil.example",
            "",
        ] {
            assert!(!is_own_host(Some(host)), "{host}");
            let origin = format!("http://{host}");
            assert!(!is_own_origin(Some(&origin), Some(host)), "{host}");
        }
        assert!(!is_own_host(None));
        // Another page of this machine is not this one.
        let here = Some("127.0.0.1:8420");
        for origin in [
            None,
            Some("null"),
            Some("https://127.0.0.1:8420"),
            Some("http://127.0.0.1:9000"),
            Some("http://localhost:8420"),
        ] {
            assert!(!is_own_origin(origin, here), "{origin:?}");
        }
    }
}
