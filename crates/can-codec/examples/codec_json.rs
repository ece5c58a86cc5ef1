//! Decodes and encodes the frames of a JSON request, for comparison with other libraries.
//!
//! stdin: `{"dbc": text, "decode": [{"id": 257, "data": [..bytes]}], "encode": [{"message": "M",
//! "values": {"signal": 1.5}}]}`; stdout: `{"decoded": [{"signal": value} or "UnknownId" or
//! "WrongLength"], "encoded": [[..bytes]]}`, or `{"refused": message}`.

use can_codec::{BusDbc, Dbc, Frame, SignalMap, Table};
use serde_json::{Map, Value, json};
use std::error::Error;
use std::io::{self, Read, Write};

fn main() -> Result<(), Box<dyn Error>> {
    let mut text = String::new();
    io::stdin().read_to_string(&mut text)?;
    let request: Value = serde_json::from_str(&text)?;
    let answer = match Dbc::parse(request["dbc"].as_str().ok_or("no dbc")?, "stdin") {
        Ok(dbc) => answer(&request, &dbc)?,
        Err(error) => json!({ "refused": error.to_string() }),
    };
    writeln!(io::stdout(), "{answer}")?;
    Ok(())
}

fn answer(request: &Value, dbc: &Dbc) -> Result<Value, Box<dyn Error>> {
    let maps = SignalMap::all(0, &dbc.messages);
    let bus = BusDbc {
        bus: 0,
        fd: true,
        dbc,
    };
    let table = Table::compile(&[bus], &maps)?;
    let requests = |key: &str| request[key].as_array().cloned().unwrap_or_default();
    let decoded: Result<Vec<Value>, Box<dyn Error>> = requests("decode")
        .iter()
        .map(|request| {
            let bytes: Vec<u8> = serde_json::from_value(request["data"].clone())?;
            let id = u32::try_from(request["id"].as_u64().ok_or("no id")?)?;
            let mut frame = Frame::zeroed(0, id, u8::try_from(bytes.len())?, true);
            frame
                .data
                .get_mut(..bytes.len())
                .ok_or("too long")?
                .copy_from_slice(&bytes);
            let mut slots = vec![f64::NAN; maps.len()];
            Ok(match table.decode(&frame, &mut slots) {
                Err(error) => json!(format!("{error:?}")),
                Ok(index) => {
                    let slots_of = index.into_iter().flat_map(|index| table.slots(index));
                    let values =
                        slots_of.map(|slot| (maps[slot].1.signal.clone(), json!(slots[slot])));
                    Value::Object(values.collect::<Map<_, _>>())
                }
            })
        })
        .collect();
    let encoded: Result<Vec<Value>, Box<dyn Error>> = requests("encode")
        .iter()
        .map(|request| {
            let message = request["message"].as_str().ok_or("no message")?;
            let slots: Vec<f64> = maps
                .iter()
                .map(|(_, map)| match request["values"][&map.signal].as_f64() {
                    Some(value) if map.message == message => value,
                    _ => 0.0,
                })
                .collect();
            let index = (0..table.message_count())
                .find(|&i| table.message(i).is_some_and(|entry| entry.name == message))
                .ok_or("no such message")?;
            let mut frame = Frame::zeroed(0, 0, 0, false);
            if !table.encode(index, &slots, &mut frame) {
                return Err("not finite".into());
            }
            Ok(json!(frame.payload()))
        })
        .collect();
    Ok(json!({ "decoded": decoded?, "encoded": encoded? }))
}
