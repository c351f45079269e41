//! A thread that waits for a device, so that training need not.

use std::sync::mpsc::{self, Receiver, Sender};
use std::thread;

type Errand = Box<dyn FnOnce() + Send>;

/// Fetches one thing after the other, in the order in which it was asked to.
///
/// One thread for all errands: a device keeps queues, and memory to copy through, for every thread that
/// talks to it.
#[derive(Debug)]
pub(super) struct Courier {
    errands: Sender<Errand>,
}

/// What a courier was sent for.
#[derive(Debug)]
pub(super) struct Parcel<T>(Receiver<T>);

impl Courier {
    /// A courier whose thread ends when this is dropped and all errands are done.
    pub(super) fn new() -> Self {
        let (errands, todo) = mpsc::channel::<Errand>();
        thread::spawn(move || todo.into_iter().for_each(|errand| errand()));
        Self { errands }
    }

    /// Has `fetch` done on the courier's thread.
    pub(super) fn send<T: Send + 'static>(
        &self,
        fetch: impl FnOnce() -> T + Send + 'static,
    ) -> Parcel<T> {
        let (hand_over, parcel) = mpsc::channel();
        let errand = Box::new(move || {
            // Nobody may be waiting any more.
            let _ = hand_over.send(fetch());
        });
        // A courier who is lost on the way is missed when the parcel is opened.
        let _ = self.errands.send(errand);
        Parcel(parcel)
    }
}

impl<T> Parcel<T> {
    /// Waits for it.
    ///
    /// # Panics
    /// When fetching it panicked, as it does when the device is lost.
    pub(super) fn open(self) -> T {
        match self.0.recv() {
            Ok(content) => content,
            Err(_) => panic!("the device was lost while something was read from it"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errands_are_done_in_their_order_while_the_sender_goes_on() {
        let courier = Courier::new();
        let (go, wait) = mpsc::channel::<u32>();
        let first = courier.send(move || wait.recv());
        let second = courier.send(|| thread::current().id());
        // Had the first been waited for, this would never be said.
        go.send(7).expect("the courier waits for it");
        assert_eq!(first.open(), Ok(7));
        assert_ne!(second.open(), thread::current().id());
    }

    #[test]
    fn a_parcel_that_nobody_opens_holds_nobody_up() {
        let courier = Courier::new();
        drop(courier.send(|| 1));
        assert_eq!(courier.send(|| 2).open(), 2);
    }

    #[test]
    #[should_panic(expected = "the device was lost")]
    fn what_panics_on_the_way_is_not_waited_for_forever() {
        let courier = Courier::new();
        courier.send(|| panic!("no device")).open()
    }
}
