//! Serves the page: its files, the stream of news, and the page's wishes.

use super::control::{Control, Wish};
use super::hub::{Cursor, Hub, News};
use problem::Problem;
use std::io::{self, Read, Write};
use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use tiny_http::{Header, Method, Request, Response};

/// Files of the page: name, type, content.
const FILES: &[(&str, &str, &[u8])] = &[
    ("", "text/html", include_bytes!("page/index.html")),
    ("style.css", "text/css", include_bytes!("page/style.css")),
    ("main.js", "text/javascript", include_bytes!("page/main.js")),
    (
        "store.js",
        "text/javascript",
        include_bytes!("page/store.js"),
    ),
    (
        "plots.js",
        "text/javascript",
        include_bytes!("page/plots.js"),
    ),
    (
        "panels.js",
        "text/javascript",
        include_bytes!("page/panels.js"),
    ),
    (
        "robot.js",
        "text/javascript",
        include_bytes!("page/robot.js"),
    ),
    (
        "vendor/uplot.min.js",
        "text/javascript",
        include_bytes!("page/vendor/uplot.min.js"),
    ),
    (
        "vendor/uplot.min.css",
        "text/css",
        include_bytes!("page/vendor/uplot.min.css"),
    ),
    (
        "vendor/three.min.js",
        "text/javascript",
        include_bytes!("page/vendor/three.min.js"),
    ),
    (
        "vendor/LICENCES.txt",
        "text/plain",
        include_bytes!("page/vendor/LICENCES.txt"),
    ),
];

/// The browser loads nothing from elsewhere, whatever a robot's name or an event's text may hold.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; \
                      img-src 'self' data: blob:; connect-src 'self'; base-uri 'none'; form-action 'none'; \
                      frame-ancestors 'none'";
/// Interval of the news: that of a screen's pictures.
const INTERVAL: Duration = Duration::from_millis(16);
/// Rows in one piece of news, a few megabytes at most.
const MOST_ROWS: usize = 2000;
/// Longest wish.
const WISH_BYTES: u64 = 4096;
/// A sign of life, so that a page that has gone is noticed.
const PATIENCE: Duration = Duration::from_secs(1);

/// What pages get, and may ask.
pub(super) struct Pages {
    /// The first part of every path.
    pub(super) token: String,
    pub(super) hub: Arc<Hub>,
    pub(super) control: Option<Control>,
    /// Served to this machine alone.
    pub(super) loopback: bool,
}

/// A server on an address.
pub(super) struct Server {
    server: tiny_http::Server,
    pub(super) address: SocketAddr,
}

impl Server {
    pub(super) fn bind(address: SocketAddr) -> Result<Self, Problem> {
        let refused = |e: &dyn std::fmt::Display| {
            Problem::new(
                format!("--listen {address}: {e}"),
                "an address of this machine and a port that is free",
            )
        };
        let server = tiny_http::Server::http(address).map_err(|e| refused(&e))?;
        let address = server.server_addr().to_ip().unwrap_or(address);
        Ok(Self { server, address })
    }

    /// Serves until `stop` is set; a thread for each request.
    pub(super) fn run(&self, pages: Pages, stop: &AtomicBool) {
        let pages = Arc::new(pages);
        while !stop.load(Ordering::Relaxed) {
            match self.server.recv_timeout(Duration::from_millis(100)) {
                Ok(Some(request)) => {
                    let pages = Arc::clone(&pages);
                    std::thread::spawn(move || {
                        // The browser has gone.
                        let _ = pages.serve(request);
                    });
                }
                Ok(None) => {}
                Err(e) => {
                    eprintln!("cannot serve: {e}");
                    return;
                }
            }
        }
    }
}

impl Pages {
    fn serve(&self, request: Request) -> io::Result<()> {
        let path = request.url().split('?').next().unwrap_or_default();
        let rest = path.strip_prefix('/').and_then(|p| p.split_once('/'));
        let Some((token, name)) = rest.filter(|(token, _)| same(token, &self.token)) else {
            let text = "not this address: it is the one that torquectl view has printed\n";
            return request.respond(Response::from_string(text).with_status_code(404));
        };
        debug_assert_eq!(token, self.token);
        if let Some(why) = self.refused(&request) {
            return request.respond(Response::from_string(why).with_status_code(403));
        }
        match (request.method(), name) {
            (Method::Get, "stream") => self.stream(request),
            (Method::Post, "ask") => self.ask(request),
            (Method::Get, name) => match FILES.iter().find(|(file, ..)| *file == name) {
                Some((_, kind, content)) => {
                    let response = Response::from_data(*content);
                    let response = response
                        .with_header(header("Content-Type", &format!("{kind}; charset=utf-8")))
                        .with_header(header("Content-Security-Policy", POLICY))
                        .with_header(header("Referrer-Policy", "no-referrer"))
                        .with_header(header("X-Content-Type-Options", "nosniff"))
                        .with_header(header("Cache-Control", "no-store"));
                    request.respond(response)
                }
                None => {
                    request.respond(Response::from_string("no such file\n").with_status_code(404))
                }
            },
            _ => request.respond(Response::from_string("GET or POST\n").with_status_code(405)),
        }
    }

    /// Why a request is not one of the page's own; none if it is. The host is an address, never a name, so that no
    /// other site's name can be led here; and what another site's page asks for carries that site's origin.
    fn refused(&self, request: &Request) -> Option<&'static str> {
        let value = |name: &'static str| {
            let found = request.headers().iter().find(|h| h.field.equiv(name));
            found.map(|h| h.value.as_str())
        };
        let host = value("Host").unwrap_or_default();
        if !is_own_host(host, self.loopback) {
            return Some("not this host: open the address that torquectl view has printed\n");
        }
        let own = |origin: &str| origin.strip_prefix("http://") == Some(host);
        let other_site = value("Sec-Fetch-Site").is_some_and(|site| !is_own_site(site));
        if other_site || value("Origin").is_some_and(|origin| !own(origin)) {
            return Some("asked for by another site's page\n");
        }
        None
    }

    /// News without end, each as its length, its kind and its bytes.
    fn stream(&self, request: Request) -> io::Result<()> {
        let mut out = request.into_writer();
        out.write_all(
            b"HTTP/1.1 200 OK\r\nContent-Type: application/octet-stream\r\n\
              Cache-Control: no-store\r\nConnection: close\r\n\r\n",
        )?;
        let mut cursor = Cursor::default();
        let mut bytes = Vec::new();
        loop {
            let news = self.hub.news(&mut cursor, MOST_ROWS, PATIENCE);
            bytes.clear();
            encode(&news, &mut bytes);
            out.write_all(&bytes)?;
            out.flush()?;
            if news.closed {
                return Ok(());
            }
            if news.times.len() < MOST_ROWS {
                std::thread::sleep(INTERVAL);
            }
        }
    }

    fn ask(&self, mut request: Request) -> io::Result<()> {
        let mut text = String::new();
        request
            .as_reader()
            .take(WISH_BYTES)
            .read_to_string(&mut text)?;
        let (code, words) = match &self.control {
            None => (
                403,
                "this page only shows; start `torquectl view --control`".to_owned(),
            ),
            Some(control) => match serde_json::from_str::<Wish>(&text) {
                Err(e) => (400, format!("not a wish: {e}")),
                Ok(wish) => match control.carry_out(wish) {
                    Ok(words) => (200, words),
                    Err(words) => (409, words),
                },
            },
        };
        request.respond(Response::from_string(words).with_status_code(code))
    }
}

/// Whether a request's host is this server: an address of this machine, where only that is served.
fn is_own_host(host: &str, loopback: bool) -> bool {
    let name = match host.rsplit_once(':') {
        Some((name, port)) if port.bytes().all(|b| b.is_ascii_digit()) => name,
        _ => host,
    };
    if name == "localhost" {
        return true;
    }
    let bare = name.strip_prefix('[').and_then(|n| n.strip_suffix(']'));
    let address = bare.unwrap_or(name).parse::<IpAddr>();
    address.is_ok_and(|address| !loopback || address.is_loopback())
}

/// Whether a browser says that the page itself, or the user, asks.
fn is_own_site(site: &str) -> bool {
    matches!(site, "same-origin" | "none")
}

/// Compares all bytes, whichever differ: the time shows nothing of the token.
fn same(one: &str, other: &str) -> bool {
    let differ = one
        .bytes()
        .zip(other.bytes())
        .fold(0, |d, (a, b)| d | (a ^ b));
    one.len() == other.len() && differ == 0
}

fn header(name: &str, value: &str) -> Header {
    // Names and values are constants of this file, in ASCII.
    Header::from_bytes(name, value).unwrap_or_else(|()| unreachable!("an ASCII header"))
}

/// Kinds of news.
mod kind {
    pub(super) const SCENE: u32 = 1;
    pub(super) const STATUS: u32 = 2;
    pub(super) const EVENTS: u32 = 3;
    pub(super) const ROWS: u32 = 4;
    pub(super) const SIGN_OF_LIFE: u32 = 5;
}

fn encode(news: &News, out: &mut Vec<u8>) {
    if let Some(scene) = &news.scene {
        piece(out, kind::SCENE, |out| out.extend(scene.as_bytes()));
    }
    if !news.events.is_empty() {
        let events = serde_json::Value::from(news.events.clone()).to_string();
        piece(out, kind::EVENTS, |out| out.extend(events.as_bytes()));
    }
    if !news.times.is_empty() {
        piece(out, kind::ROWS, |out| {
            let count = news.times.len() as u32;
            out.extend(count.to_le_bytes());
            out.extend((news.lost as u32).to_le_bytes());
            for t in &news.times {
                out.extend(t.to_le_bytes());
            }
            for x in &news.rows {
                out.extend(x.to_le_bytes());
            }
        });
    }
    if let Some(status) = &news.status {
        piece(out, kind::STATUS, |out| out.extend(status.as_bytes()));
    }
    if out.is_empty() {
        piece(out, kind::SIGN_OF_LIFE, |_| ());
    }
}

fn piece(out: &mut Vec<u8>, kind: u32, content: impl FnOnce(&mut Vec<u8>)) {
    let begin = out.len();
    out.extend([0; 4]);
    out.extend(kind.to_le_bytes());
    content(out);
    let length = (out.len() - begin - 8) as u32;
    out[begin..begin + 4].copy_from_slice(&length.to_le_bytes());
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hosts_are_addresses_of_this_machine() {
        for own in [
            "127.0.0.1:8731",
            "127.0.0.1",
            "localhost:1",
            "[::1]:8731",
            "[::1]",
        ] {
            assert!(is_own_host(own, true), "{own}");
        }
        for other in [
            "",
            "robot.example:8731",
            "localhost.example",
            "192.168.1.2:8731",
            "127.0.0.1.example:80",
            "127.0.0.1:80:80",
        ] {
            assert!(!is_own_host(other, true), "{other}");
        }
        assert!(is_own_host("192.168.1.2:8731", false));
        assert!(!is_own_host("robot.example:8731", false));
    }

    #[test]
    fn tokens_are_compared_whole() {
        assert!(same("ab", "ab") && !same("ab", "aa") && !same("a", "ab") && !same("", "ab"));
    }
}
