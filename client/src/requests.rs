//! Requests to the daemon: an operator's, tares, and the choice of a contact set.

use std::hash::{BuildHasher, Hasher, RandomState};
use std::thread::sleep;
use std::time::{Duration, Instant};

use iceoryx2::prelude::PortFactory;
use robot_state::{Answer, Name, Request, answer_status, request};

use crate::channel::{self, AnswerMessage, RequestMessage};
use crate::client::{Client, take};
use crate::error::Error;

/// Longest time without an answer; the daemon sends ten a second while it works on a request.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(2);
/// Interval between polls for an answer.
const POLL: Duration = Duration::from_millis(1);

impl Client {
    /// Tares the F/T sensors of a robot at rest in mode hold, touched by the contacts of the contact
    /// set of that name. Waits until it is done; the answer has the new offsets and those before.
    ///
    /// # Errors
    /// [`Error::Refused`] with the reason, and those of [`Client::request`].
    pub fn tare(&self, contact_set: &str) -> Result<Answer, Error> {
        self.request(request::TARE, contact_set, |_| ())
    }

    /// Tares one joint of a robot that holds: it is known to carry `torque`, N·m, with the standard
    /// deviation `sigma`. Its calibrated torsion and motor current get their zeros from that; until the
    /// daemon ends.
    ///
    /// # Errors
    /// As [`Client::tare`].
    pub fn tare_joint(&self, joint: usize, torque: f64, sigma: f64) -> Result<Answer, Error> {
        let asked = Request {
            kind: request::TARE_JOINT,
            joint: joint as u32,
            torque,
            sigma,
            ..Request::default()
        };
        self.send_request(asked, |_| ())
    }

    /// The offsets in use, and when and with which contacts they were found.
    ///
    /// # Errors
    /// As [`Client::tare`].
    pub fn last_tare(&self) -> Result<Answer, Error> {
        self.request(request::SHOW_TARE, "", |_| ())
    }

    /// Discards the offsets of all tares; those of the configuration are used again.
    ///
    /// # Errors
    /// As [`Client::tare`].
    pub fn forget_tare(&self) -> Result<Answer, Error> {
        self.request(request::FORGET_TARE, "", |_| ())
    }

    /// Uses that contact set from now on, one of `Description::contact_set_names`.
    ///
    /// # Errors
    /// As [`Client::tare`].
    pub fn choose_contact_set(&self, name: &str) -> Result<Answer, Error> {
        self.request(request::CHOOSE_CONTACT_SET, name, |_| ())
    }

    /// Lets the automatic rule choose the contact set from now on.
    ///
    /// # Errors
    /// As [`Client::tare`].
    pub fn automatic_contact_set(&self) -> Result<Answer, Error> {
        self.request(request::AUTOMATIC_CONTACT_SET, "", |_| ())
    }

    /// Switches the drives on and waits until every joint is held where it stands. A client that
    /// commands is followed once it has asked for hold. The records' `state` shows the result.
    ///
    /// # Errors
    /// As [`Client::tare`].
    pub fn enable(&self) -> Result<Answer, Error> {
        self.request(request::ENABLE, "", |_| ())
    }

    /// Ends all set-points and switches the drives off; waits until it is so.
    ///
    /// # Errors
    /// As [`Client::tare`].
    pub fn disable(&self) -> Result<Answer, Error> {
        self.request(request::DISABLE, "", |_| ())
    }

    /// Brings the robot to rest and waits until it holds. Whoever commands it must ask for hold
    /// before it is followed again.
    ///
    /// # Errors
    /// As [`Client::tare`].
    pub fn stop(&self) -> Result<Answer, Error> {
        self.request(request::STOP, "", |_| ())
    }

    /// Acknowledges the latched fault of that number, that of `CycleRecord::fault`.
    ///
    /// # Errors
    /// As [`Client::tare`].
    pub fn acknowledge(&self, fault: u32) -> Result<Answer, Error> {
        let asked = Request {
            kind: request::ACKNOWLEDGE,
            fault,
            ..Request::default()
        };
        self.send_request(asked, |_| ())
    }

    /// Sends a request, one of [`request`], and waits for its last answer; `progress` receives those
    /// before it. Several clients may have requests open.
    ///
    /// # Errors
    /// As [`Client::send_request`].
    pub fn request(
        &self,
        kind: u32,
        contact_set: &str,
        progress: impl FnMut(&Answer),
    ) -> Result<Answer, Error> {
        let asked = Request {
            kind,
            contact_set: Name::new(contact_set),
            ..Request::default()
        };
        self.send_request(asked, progress)
    }

    /// [`Client::request`] with all fields of the request but `id`, which is chosen here.
    ///
    /// # Errors
    /// [`Error::Refused`], [`Error::Unanswered`], [`Error::Gone`], [`Error::TooManyRequests`],
    /// [`Error::NoDaemon`], [`Error::OtherLayout`], [`Error::Transport`].
    pub fn send_request(
        &self,
        asked: Request,
        mut progress: impl FnMut(&Answer),
    ) -> Result<Answer, Error> {
        let robot = || self.robot().to_owned();
        let too_many = || Error::TooManyRequests { robot: robot() };
        // The answers' receiver is opened first, so that none is missed.
        let answers = channel::open::<AnswerMessage>(&self.node, self.robot(), Duration::ZERO)?;
        let answers = channel::receiver(&self.node, &answers)?;
        let service = channel::open::<RequestMessage>(&self.node, self.robot(), Duration::ZERO)?;
        let requests = channel::sender(&self.node, &service)?.ok_or_else(too_many)?;
        let asked = Request {
            // Random, so different from that of any other request.
            id: RandomState::new().build_hasher().finish(),
            ..asked
        };
        let listeners = requests
            .send_copy(RequestMessage(asked))
            .map_err(|e| Error::transport(service.name(), "publish on", &e))?;
        if listeners == 0 {
            return Err(Error::Gone { robot: robot() });
        }
        let mut last_answer = Instant::now();
        loop {
            let Some(message) = take(&answers)? else {
                if last_answer.elapsed() > ANSWER_TIMEOUT {
                    let waited = ANSWER_TIMEOUT;
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
            last_answer = Instant::now();
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
