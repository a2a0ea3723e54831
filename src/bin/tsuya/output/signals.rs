//! What SIGHUP, SIGINT and SIGTERM do: nothing half-made stays behind, and the program ends as by the signal itself.

/// From here on these signals first remove what is being made.
#[cfg(unix)]
pub fn clean_up_on_signals() {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
    // What is to be ignored (nohup, jobs of scripts in the background) stays ignored.
    let heard: Vec<i32> = [SIGHUP, SIGINT, SIGTERM].into_iter().filter(|&signal| !is_ignored(signal)).collect();
    let Ok(mut signals) = signal_hook::iterator::Signals::new(heard) else { return };
    let wait = move || {
        if let Some(signal) = signals.forever().next() {
            super::staging::abandon_all();
            let _ = signal_hook::low_level::emulate_default_handler(signal);
        }
    };
    let _ = std::thread::Builder::new().name("signals".into()).spawn(wait);
}

/// Waits for the program's end where a signal removes what was being made: an error is its doing then, and no exit code of its own.
pub fn wait_for_signal() {
    drop(super::staging::making());
}

/// Elsewhere the next run that writes into the same folder cleans up.
#[cfg(not(unix))]
pub fn clean_up_on_signals() {}

/// Whether the process was started with a signal ignored, as far as the system tells.
#[cfg(unix)]
fn is_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0);
    mask >> (signal - 1) & 1 == 1
}
