//! Asking the daemon for what is needed now and then: a tare, other contacts.

use std::hash::{BuildHasher, Hasher, RandomState};
use std::thread::sleep;
use std::time::{Duration, Instant};

use iceoryx2::prelude::PortFactory;
use robot_state::{Answer, Name, Request, answer_status, request};

use crate::channel::{self, AnswerMessage, RequestMessage};
use crate::client::{Client, take};
use crate::error::Error;

/// The daemon answers ten times a second as long as it works on a request.
const SILENCE: Duration = Duration::from_secs(2);
/// Between two looks for an answer.
const POLL: Duration = Duration::from_millis(1);

impl Client {
    /// Tares the F/T sensors of a robot at rest in mode hold: `contact_set` names the set of contacts
    /// that says what touches it. Waits until it is done; the answer has the new offsets and what
    /// they were before.
    ///
    /// # Errors
    /// [`Error::Refused`] with the reason, and what [`Client::request`] says.
    pub fn tare(&self, contact_set: &str) -> Result<Answer, Error> {
        self.request(request::TARE, contact_set, |_| ())
    }

    /// The offsets in use, and when and with which contacts they were found.
    ///
    /// # Errors
    /// As [`Client::tare`].
    pub fn last_tare(&self) -> Result<Answer, Error> {
        self.request(request::SHOW_TARE, "", |_| ())
    }

    /// Gives up what tares have found: offsets are those of the configuration.
    ///
    /// # Errors
    /// As [`Client::tare`].
    pub fn forget_tare(&self) -> Result<Answer, Error> {
        self.request(request::FORGET_TARE, "", |_| ())
    }

    /// From now on the robot has the contacts of that set, one of
    /// `Description::contact_set_names`.
    ///
    /// # Errors
    /// As [`Client::tare`].
    pub fn choose_contact_set(&self, name: &str) -> Result<Answer, Error> {
        self.request(request::CHOOSE_CONTACT_SET, name, |_| ())
    }

    /// From now on the automatic rule chooses the set of contacts.
    ///
    /// # Errors
    /// As [`Client::tare`].
    pub fn automatic_contact_set(&self) -> Result<Answer, Error> {
        self.request(request::AUTOMATIC_CONTACT_SET, "", |_| ())
    }

    /// Sends a request, one of [`request`], and waits for its last answer; `progress` sees those
    /// before it. Several clients may ask at once.
    ///
    /// # Errors
    /// [`Error::Refused`], [`Error::Unanswered`], [`Error::Gone`], [`Error::TooManyAsking`],
    /// [`Error::NoDaemon`], [`Error::OtherLayout`], [`Error::Transport`].
    pub fn request(
        &self,
        kind: u32,
        contact_set: &str,
        mut progress: impl FnMut(&Answer),
    ) -> Result<Answer, Error> {
        let robot = || self.robot().to_owned();
        let too_many = || Error::TooManyAsking { robot: robot() };
        // Whoever asks listens first.
        let answers = channel::open::<AnswerMessage>(&self.node, self.robot(), Duration::ZERO)?;
        let answers = channel::receiver(&self.node, &answers)?;
        let service = channel::open::<RequestMessage>(&self.node, self.robot(), Duration::ZERO)?;
        let requests = channel::sender(&self.node, &service)?.ok_or_else(too_many)?;
        let asked = Request {
            // Random: unlike that of any other client.
            id: RandomState::new().build_hasher().finish(),
            kind,
            contact_set: Name::new(contact_set),
            ..Request::default()
        };
        let listeners = requests
            .send_copy(RequestMessage(asked))
            .map_err(|e| Error::transport(service.name(), "publish on", &e))?;
        if listeners == 0 {
            return Err(Error::Gone { robot: robot() });
        }
        let mut heard = Instant::now();
        loop {
            let Some(message) = take(&answers)? else {
                if heard.elapsed() > SILENCE {
                    let waited = SILENCE;
                    return Err(Error::Unanswered {
                        robot: robot(),
                        waited,
                    });
                }
                sleep(POLL);
                continue;
            };
            let answer = message.payload().0;
            if answer.id != asked.id {
                continue;
            }
            heard = Instant::now();
            match answer.status {
                answer_status::DONE => return Ok(answer),
                answer_status::REFUSED => {
                    return Err(Error::Refused {
                        reason: answer.text.to_string(),
                    });
                }
                _ => progress(&answer),
            }
        }
    }
}
