//! The slots of a light worker: who waits for one gets that which has been free for longest.

use std::collections::VecDeque;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;
use tokio::sync::{Semaphore, SemaphorePermit};

/// All of a worker.
pub struct Slots {
    room: Semaphore,
    /// Since when those are free that are.
    free: Mutex<VecDeque<Instant>>,
}

/// One that is taken.
pub struct Slot<'a> {
    slots: &'a Slots,
    /// Since when it had been free.
    pub free_since: Instant,
    _permit: SemaphorePermit<'a>,
}

impl Slots {
    /// All free since now.
    pub fn new(count: u32) -> Self {
        let free = std::iter::repeat_n(Instant::now(), count as usize).collect();
        Self { room: Semaphore::new(count as usize), free: Mutex::new(free) }
    }

    /// Waits for one; who came first is first.
    pub async fn take(&self) -> Slot<'_> {
        let permit = self.room.acquire().await.expect("it is never closed");
        let free_since = self.free.lock().unwrap_or_else(PoisonError::into_inner).pop_front();
        Slot { slots: self, free_since: free_since.unwrap_or_else(Instant::now), _permit: permit }
    }
}

impl Drop for Slot<'_> {
    fn drop(&mut self) {
        // Before the permit is given back: fields are dropped after this.
        self.slots.free.lock().unwrap_or_else(PoisonError::into_inner).push_back(Instant::now());
    }
}
