//! Messages of a recording by its content.

use robot_state::Content;

use crate::compact::Counts;
use crate::frames::FramesCoder;
use crate::message::{CycleMessage, Decoder};
use crate::torques::TorquesCoder;

/// Writes and reads our own messages.
#[derive(Debug, Clone)]
pub(crate) enum Coder {
    All(Decoder),
    Frames(FramesCoder),
    Torques(TorquesCoder),
}

impl Coder {
    pub(crate) fn new(content: Content, counts: Counts) -> Self {
        match content {
            Content::All => Self::All(Decoder::new(counts)),
            Content::Frames => Self::Frames(FramesCoder::new(counts)),
            Content::Torques => Self::Torques(TorquesCoder::new(counts)),
        }
    }

    /// The message as the file holds it; `bytes` is that of the loop, `message` the same decoded.
    pub(crate) fn encode<'a>(
        &mut self,
        bytes: &'a [u8],
        message: &CycleMessage,
        own: &'a mut Vec<u8>,
    ) -> &'a [u8] {
        own.clear();
        match self {
            Self::All(_) => return bytes,
            Self::Frames(coder) => coder.put(message, own),
            Self::Torques(coder) => coder.put(message, own),
        }
        own
    }

    /// Reads a message of the file; `None` if the bytes are none.
    pub(crate) fn decode(&mut self, bytes: &[u8], message: &mut CycleMessage) -> Option<()> {
        match self {
            Self::All(decoder) => decoder.decode(bytes, message),
            Self::Frames(coder) => coder.take(bytes, message),
            Self::Torques(coder) => coder.take(bytes, message),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use can_codec::Frame;
    use test_support::Random;

    /// Checksums keep damage away from decoders, but not what somebody writes on purpose.
    #[test]
    fn any_bytes_are_refused_or_read() {
        let counts = Counts {
            joints: 2,
            sensors: 1,
            further_imus: 0,
        };
        let mut random = Random::new(11);
        for content in Content::ALL {
            let mut message = CycleMessage::default();
            for id in 0..5 {
                message.rx.push(Frame::zeroed(0, id, 8, false));
            }
            let (mut own, mut read) = (Vec::new(), CycleMessage::default());
            let whole = Coder::new(content, counts)
                .encode(&[], &message, &mut own)
                .to_vec();
            if content != Content::All {
                let mut coder = Coder::new(content, counts);
                assert!(coder.decode(&whole, &mut read).is_some());
            }
            let mut refused = 0;
            for _ in 0..2000 {
                let mut coder = Coder::new(content, counts);
                let mut bytes = whole.clone();
                bytes.truncate(random.below(whole.len().max(1)) + 1);
                for _ in 0..1 + random.below(3) {
                    if !bytes.is_empty() {
                        let place = random.below(bytes.len().min(40));
                        bytes[place] = random.bits() as u8;
                    }
                }
                refused += usize::from(coder.decode(&bytes, &mut read).is_none());
            }
            assert!(refused > 1000, "{content}: {refused}");
        }
    }
}
