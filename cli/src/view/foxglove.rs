//! `torquectl view --foxglove`: the messages of recordings, live, by Foxglove's WebSocket protocol.
//!
//! <https://github.com/foxglove/ws-protocol/blob/main/docs/spec.md>: the server names its channels, a client subscribes
//! to some, and each message goes out as a binary frame. The crate `foxglove` would add about a hundred crates, an
//! asynchronous runtime among them, for what stands here.

use problem::Problem;
use recording::{RosChannel, RosMessages};
use serde::Deserialize;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::io::{self, ErrorKind};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, SystemTime, UNIX_EPOCH};
use torqued_client::Client;
use torqued_client::robot_state::{Description, Name};
use tungstenite::handshake::server::{ErrorResponse, Request, Response};
use tungstenite::http::{HeaderValue, StatusCode};
use tungstenite::{Message, WebSocket};

/// Port that Foxglove proposes.
pub(super) const ADDRESS: &str = "127.0.0.1:8765";
/// Names of the protocol, the newer one first.
const PROTOCOLS: [&str; 2] = ["foxglove.sdk.v1", "foxglove.websocket.v1"];
/// Pages of Foxglove that may connect from a browser; its desktop program names no site.
const PAGES: [&str; 2] = ["https://app.foxglove.dev", "https://studio.foxglove.dev"];
/// Records that wait for a slow client, a second of them; later ones are left out.
const WAITING: usize = 1000;
/// Longest time without a record until a client's own messages are looked for.
const LOOK: Duration = Duration::from_millis(20);
/// Longest time for a client's first words.
const HANDSHAKE: Duration = Duration::from_secs(2);
/// Longest message of a client.
const MOST_BYTES: usize = 1 << 20;
const MESSAGE_DATA: u8 = 1;

/// The messages of one record, in the order of the channels, and their time, ns since 1970.
struct Moment {
    unix_ns: u64,
    messages: Vec<Vec<u8>>,
}

type Clients = Mutex<Vec<SyncSender<Arc<Moment>>>>;

/// A client's wish.
#[derive(Deserialize)]
#[serde(tag = "op", rename_all = "camelCase", rename_all_fields = "camelCase")]
enum Wish {
    Subscribe {
        subscriptions: Vec<Subscription>,
    },
    Unsubscribe {
        subscription_ids: Vec<u32>,
    },
    #[serde(other)]
    Other,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Subscription {
    id: u32,
    channel_id: usize,
}

/// Serves from now on, until the process ends; the address.
pub(super) fn serve(address: SocketAddr, client: Client) -> Result<SocketAddr, Problem> {
    let refused = |e: &dyn std::fmt::Display| {
        let allowed = "an address of this machine and a port that is free";
        Problem::new(format!("--foxglove {address}: {e}"), allowed)
    };
    let listener = TcpListener::bind(address).map_err(|e| refused(&e))?;
    let address = listener.local_addr().map_err(|e| refused(&e))?;
    let messages = messages_of(client.description());
    let words: Arc<[Value]> = [server_info(&client), advertise(&messages.channels())].into();
    let clients = Arc::new(Clients::default());
    let served = Arc::clone(&clients);
    let reader = thread::Builder::new().name("foxglove".to_owned());
    let reader = reader.spawn(move || read(client, messages, &served));
    reader.map_err(|e| refused(&e))?;
    let accept = thread::Builder::new().name("foxglove-accept".to_owned());
    let accept = accept.spawn(move || {
        for stream in listener.incoming().flatten() {
            let (clients, words) = (Arc::clone(&clients), Arc::clone(&words));
            // A client that goes ends its thread.
            thread::spawn(move || converse(stream, &clients, &words));
        }
    });
    accept.map_err(|e| refused(&e))?;
    Ok(address)
}

fn messages_of(robot: &Description) -> RosMessages {
    let names = |names: &[Name], count: u32| -> Vec<String> {
        let names = names.iter().take(count as usize);
        names.map(|name| name.as_str().to_owned()).collect()
    };
    let joints = names(&robot.joint_names, robot.joint_count);
    let sensors = names(&robot.ft_names, robot.ft_count);
    RosMessages::new(&joints, &sensors, &[])
}

fn server_info(client: &Client) -> Value {
    json!({
        "op": "serverInfo",
        "name": format!("torqued: {}", client.robot()),
        "capabilities": [],
        "supportedEncodings": [],
        "metadata": {"torqued": env!("CARGO_PKG_VERSION")},
        "sessionId": unix_ns().to_string(),
    })
}

fn advertise(channels: &[RosChannel]) -> Value {
    let channels = channels.iter().enumerate().map(|(id, channel)| {
        json!({
            "id": id,
            "topic": channel.topic,
            "encoding": RosChannel::ENCODING,
            "schemaName": channel.schema_name,
            "schema": channel.schema,
            "schemaEncoding": RosChannel::SCHEMA_ENCODING,
        })
    });
    json!({"op": "advertise", "channels": channels.collect::<Value>()})
}

/// Reads every record, also of a daemon that takes over, and gives its messages to all clients.
fn read(mut client: Client, mut messages: RosMessages, clients: &Clients) {
    // Stamps count from any instant: the first one read is now.
    let mut offset_ns = None;
    let mut last_ns = 0;
    loop {
        let Ok(record) = client.next_record(Duration::from_millis(500)) else {
            offset_ns = None;
            continue;
        };
        let stamp_ns = record.cycle.stamp_ns;
        if stamp_ns < last_ns {
            offset_ns = None;
        }
        last_ns = stamp_ns;
        let offset_ns = *offset_ns.get_or_insert_with(|| unix_ns().wrapping_sub(stamp_ns));
        let mut clients = clients.lock().unwrap_or_else(PoisonError::into_inner);
        if clients.is_empty() {
            continue;
        }
        let mut moment = Moment {
            unix_ns: stamp_ns.wrapping_add(offset_ns),
            messages: Vec::new(),
        };
        let keep = |_, bytes: &[u8]| {
            moment.messages.push(bytes.to_vec());
            Ok::<_, std::convert::Infallible>(())
        };
        let Ok(()) = messages.write(moment.unix_ns, &record.cycle, keep);
        let moment = Arc::new(moment);
        clients.retain(|client| {
            let sent = client.try_send(Arc::clone(&moment));
            !matches!(sent, Err(TrySendError::Disconnected(_)))
        });
    }
}

fn unix_ns() -> u64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    since.map_or(0, |since| since.as_nanos() as u64)
}

/// One client, until it goes.
fn converse(stream: TcpStream, clients: &Clients, words: &[Value]) {
    let accepted = || {
        stream.set_read_timeout(Some(HANDSHAKE))?;
        stream.set_nodelay(true)?;
        stream.try_clone()
    };
    let Ok(own) = accepted() else {
        return;
    };
    let Ok(mut socket) = tungstenite::accept_hdr_with_config(own, answer, Some(config())) else {
        return;
    };
    let greeted = words.iter().try_for_each(|words| {
        let text = Message::text(words.to_string());
        socket.send(text)
    });
    if greeted.is_err() || stream.set_nonblocking(true).is_err() {
        return;
    }
    let (sender, moments) = sync_channel(WAITING);
    clients
        .lock()
        .unwrap_or_else(PoisonError::into_inner)
        .push(sender);
    let _ = supply(&mut socket, &moments);
}

fn config() -> tungstenite::protocol::WebSocketConfig {
    tungstenite::protocol::WebSocketConfig::default()
        .max_message_size(Some(MOST_BYTES))
        .max_frame_size(Some(MOST_BYTES))
}

/// Accepts a client that speaks the protocol, and is no page of another site.
#[expect(
    clippy::result_large_err,
    reason = "tungstenite's callback has this signature"
)]
fn answer(request: &Request, mut response: Response) -> Result<Response, ErrorResponse> {
    let header = |name: &str| {
        let value = request.headers().get(name)?.to_str().ok()?;
        Some(value.to_owned())
    };
    let refusal = |status: StatusCode, why: &str| {
        let mut response = ErrorResponse::new(Some(why.to_owned()));
        *response.status_mut() = status;
        response
    };
    if header("Origin").is_some_and(|origin| !may_connect(&origin)) {
        return Err(refusal(
            StatusCode::FORBIDDEN,
            "asked for by another site's page\n",
        ));
    }
    let offered = header("Sec-WebSocket-Protocol").unwrap_or_default();
    let offered: Vec<&str> = offered.split(',').map(str::trim).collect();
    let Some(protocol) = PROTOCOLS.into_iter().find(|own| offered.contains(own)) else {
        let why =
            "the subprotocol is not Foxglove's; allowed: foxglove.sdk.v1, foxglove.websocket.v1\n";
        return Err(refusal(StatusCode::BAD_REQUEST, why));
    };
    let name = "Sec-WebSocket-Protocol";
    response
        .headers_mut()
        .insert(name, HeaderValue::from_static(protocol));
    Ok(response)
}

/// Sites of the web other than Foxglove's and this machine's do not get the robot's torques.
fn may_connect(origin: &str) -> bool {
    // `null` is what any site's page can make its origin look like.
    let Some((scheme, host)) = origin.split_once("://") else {
        return false;
    };
    let is_port = |text: &str| text.bytes().all(|byte| byte.is_ascii_digit());
    let name = match host.rsplit_once(':') {
        Some((name, port)) if is_port(port) => name,
        _ => host,
    };
    let web = ["http", "https"].contains(&scheme);
    !web || PAGES.contains(&origin) || ["localhost", "127.0.0.1", "[::1]"].contains(&name)
}

/// Sends what is subscribed to; what a client is too slow for is left out.
fn supply(
    socket: &mut WebSocket<TcpStream>,
    moments: &Receiver<Arc<Moment>>,
) -> tungstenite::Result<()> {
    // Subscriptions by their channel.
    let mut wanted: BTreeMap<usize, Vec<u32>> = BTreeMap::new();
    let mut frame = Vec::new();
    loop {
        listen(socket, &mut wanted)?;
        let moment = match moments.recv_timeout(LOOK) {
            Ok(moment) => moment,
            Err(RecvTimeoutError::Timeout) => continue,
            Err(RecvTimeoutError::Disconnected) => return Ok(()),
        };
        if !later(socket.flush())? {
            continue;
        }
        for (channel, subscriptions) in &wanted {
            let Some(message) = moment.messages.get(*channel) else {
                continue;
            };
            for subscription in subscriptions {
                frame.clear();
                frame.push(MESSAGE_DATA);
                frame.extend(subscription.to_le_bytes());
                frame.extend(moment.unix_ns.to_le_bytes());
                frame.extend_from_slice(message);
                later(socket.write(Message::binary(frame.clone())))?;
            }
        }
        later(socket.flush())?;
    }
}

/// Takes the client's wishes that have arrived.
fn listen(
    socket: &mut WebSocket<TcpStream>,
    wanted: &mut BTreeMap<usize, Vec<u32>>,
) -> tungstenite::Result<()> {
    loop {
        let text = match socket.read() {
            Ok(Message::Text(text)) => text,
            Ok(_) => continue,
            Err(error) => return later(Err(error)).map(|_| ()),
        };
        match serde_json::from_str(&text) {
            Ok(Wish::Subscribe { subscriptions }) => {
                for Subscription { id, channel_id } in subscriptions {
                    wanted.entry(channel_id).or_default().push(id);
                }
            }
            Ok(Wish::Unsubscribe { subscription_ids }) => {
                for ids in wanted.values_mut() {
                    ids.retain(|id| !subscription_ids.contains(id));
                }
            }
            Ok(Wish::Other) | Err(_) => {}
        }
    }
}

/// Whether it is done; if not, it will be later.
fn later(result: tungstenite::Result<()>) -> tungstenite::Result<bool> {
    match result {
        Ok(()) => Ok(true),
        Err(tungstenite::Error::Io(error)) if is_later(&error) => Ok(false),
        Err(error) => Err(error),
    }
}

fn is_later(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut)
}

#[cfg(test)]
mod tests {
    use super::may_connect;

    #[test]
    fn pages_of_other_sites_may_not_connect() {
        for own in [
            "https://app.foxglove.dev",
            "http://localhost:8080",
            "http://[::1]",
            "file://",
        ] {
            assert!(may_connect(own), "{own}");
        }
        for other in [
            "null",
            "https://example.com",
            "http://app.foxglove.dev",
            "https://localhost.example.com",
        ] {
            assert!(!may_connect(other), "{other}");
        }
    }
}
