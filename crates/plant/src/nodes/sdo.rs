//! The SDO server of a simulated node (CiA 301, 7.2.4.3): expedited and segmented, one transfer at a time.

use super::objects::{Key, abort};

/// A transfer in segments.
#[derive(Debug, Clone)]
enum Transfer {
    Upload { bytes: Vec<u8>, done: usize },
    Download { key: Key, bytes: Vec<u8> },
}

/// What the node's objects do for a client.
pub(super) trait Served {
    /// The bytes of an object.
    ///
    /// # Errors
    /// The reason of an abort.
    fn read(&mut self, key: Key) -> Result<Vec<u8>, u32>;

    /// The length of an object; none: there is none.
    fn length(&self, key: Key) -> Option<usize>;

    /// Writes an object.
    ///
    /// # Errors
    /// The reason of an abort.
    fn write(&mut self, key: Key, bytes: &[u8]) -> Result<(), u32>;
}

/// The server.
#[derive(Debug, Clone, Default)]
pub(super) struct SdoServer {
    transfer: Option<Transfer>,
    /// The toggle bit that is due.
    toggle: bool,
}

impl SdoServer {
    /// Answers a request; none: nothing is due.
    pub(super) fn answer(&mut self, request: [u8; 8], served: &mut impl Served) -> Option<[u8; 8]> {
        let key = (u16::from_le_bytes([request[1], request[2]]), request[3]);
        let result = match request[0] >> 5 {
            0 => self.download_segment(&request, served),
            1 => self.download(key, &request, served),
            2 => self.upload(key, served),
            3 => self.upload_segment(&request),
            4 => {
                self.transfer = None;
                return None;
            }
            _ => Err(abort::COMMAND),
        };
        Some(result.unwrap_or_else(|code| {
            self.transfer = None;
            with_key(0x80, key, code.to_le_bytes())
        }))
    }

    fn download(
        &mut self,
        key: Key,
        request: &[u8; 8],
        served: &mut impl Served,
    ) -> Result<[u8; 8], u32> {
        let [expedited, sized] = [2, 1].map(|bit| request[0] & bit != 0);
        if expedited {
            let len = if sized {
                4 - usize::from(request[0] >> 2 & 3)
            } else {
                served.length(key).unwrap_or(4).min(4)
            };
            served.write(key, &request[4..4 + len])?;
        } else {
            let bytes = Vec::new();
            self.transfer = Some(Transfer::Download { key, bytes });
            self.toggle = false;
        }
        Ok(with_key(0x60, key, [0; 4]))
    }

    fn download_segment(
        &mut self,
        request: &[u8; 8],
        served: &mut impl Served,
    ) -> Result<[u8; 8], u32> {
        self.check_toggle(request)?;
        let Some(Transfer::Download { key, bytes }) = &mut self.transfer else {
            return Err(abort::COMMAND);
        };
        let used = 7 - usize::from(request[0] >> 1 & 7);
        bytes.extend_from_slice(&request[1..=used]);
        let (key, is_last) = (*key, request[0] & 1 != 0);
        if is_last && let Some(Transfer::Download { bytes, .. }) = self.transfer.take() {
            served.write(key, &bytes)?;
        }
        let mut answer = [0; 8];
        answer[0] = 0x20 | self.take_toggle();
        Ok(answer)
    }

    fn upload(&mut self, key: Key, served: &mut impl Served) -> Result<[u8; 8], u32> {
        let bytes = served.read(key)?;
        let mut data = [0; 4];
        if (1..=4).contains(&bytes.len()) {
            data[..bytes.len()].copy_from_slice(&bytes);
            let unused = 4 - bytes.len() as u8;
            return Ok(with_key(0x43 | unused << 2, key, data));
        }
        let len = (bytes.len() as u32).to_le_bytes();
        self.transfer = Some(Transfer::Upload { bytes, done: 0 });
        self.toggle = false;
        Ok(with_key(0x41, key, len))
    }

    fn upload_segment(&mut self, request: &[u8; 8]) -> Result<[u8; 8], u32> {
        self.check_toggle(request)?;
        let Some(Transfer::Upload { bytes, done }) = &mut self.transfer else {
            return Err(abort::COMMAND);
        };
        let rest = &bytes[*done..];
        let len = rest.len().min(7);
        let is_last = len == rest.len();
        let mut answer = [0; 8];
        answer[1..=len].copy_from_slice(&rest[..len]);
        answer[0] = (7 - len as u8) << 1 | u8::from(is_last);
        *done += len;
        if is_last {
            self.transfer = None;
        }
        answer[0] |= self.take_toggle();
        Ok(answer)
    }

    fn check_toggle(&self, request: &[u8; 8]) -> Result<(), u32> {
        if (request[0] & 0x10 != 0) == self.toggle {
            Ok(())
        } else {
            Err(abort::TOGGLE)
        }
    }

    /// The toggle bit in its place; the other one is due next.
    fn take_toggle(&mut self) -> u8 {
        let bit = u8::from(self.toggle) << 4;
        self.toggle = !self.toggle;
        bit
    }
}

fn with_key(command: u8, (index, sub): Key, data: [u8; 4]) -> [u8; 8] {
    let [low, high] = index.to_le_bytes();
    let [a, b, c, d] = data;
    [command, low, high, sub, a, b, c, d]
}
