//! The decoder as a WebAssembly module. Its interface is plain numbers; `core.js` beside it is the only caller.
//!
//! Bytes go in through one buffer ([`tsuya_input`]). What an operation gives lies in outputs ([`tsuya_output`]): the first is JSON, the
//! others are the arrays that it describes. They stay until the next operation.

mod facts;
mod operations;
mod output;

use operations::Status;
use output::Output;
use std::cell::RefCell;
use tsuya::Limits;
use tsuya::decoder::IncrementalDecoder;

#[derive(Default)]
struct State {
    input: Vec<u8>,
    outputs: Vec<Output>,
    file: Option<IncrementalDecoder>,
}

thread_local! {
    static STATE: RefCell<State> = RefCell::default();
    static PANIC: RefCell<String> = const { RefCell::new(String::new()) };
}

/// A module without threads is called once at a time; a call that comes while another one is under way finds nothing.
fn with_state<T>(run: impl FnOnce(&mut State) -> T, otherwise: T) -> T {
    STATE.with(|state| match state.try_borrow_mut() {
        Ok(mut state) => run(&mut state),
        Err(_) => otherwise,
    })
}

/// Returns the address that `length` bytes may be written to for [`tsuya_give`].
#[unsafe(no_mangle)]
pub extern "C" fn tsuya_input(length: u32) -> *mut u8 {
    with_state(
        |state| {
            state.input.clear();
            state.input.resize(length as usize, 0);
            state.input.as_mut_ptr()
        },
        std::ptr::null_mut(),
    )
}

/// Begins a file of `length` bytes, negative where that is not known. An instance holds one file.
#[unsafe(no_mangle)]
pub extern "C" fn tsuya_open(length: f64, is_seekable: u32, memory_mib: u32) {
    std::panic::set_hook(Box::new(|info| {
        let place = info.location().map(|place| format!("{}:{}", place.file(), place.line())).unwrap_or_default();
        PANIC.with(|panic| panic.replace(place));
    }));
    let length = (length >= 0.0).then_some(length as u64);
    let limits = Limits { memory_bytes: (memory_mib as u64) << 20, ..Limits::default() };
    let file = IncrementalDecoder::new(length, is_seekable != 0, limits);
    with_state(|state| state.file = Some(file), ());
}

/// Feeds the bytes in the input as those of the file from `offset` on.
#[unsafe(no_mangle)]
pub extern "C" fn tsuya_give(offset: f64) -> u32 {
    with_state(
        |state| {
            let input = std::mem::take(&mut state.input);
            let given = state.file.as_mut().map(|file| file.feed(offset as u64, &input));
            let (status, outputs) = operations::answer(given, |()| (Status::Ready, Vec::new()));
            state.outputs = outputs;
            status as u32
        },
        Status::Error as u32,
    )
}

/// Sets the length of the file.
#[unsafe(no_mangle)]
pub extern "C" fn tsuya_end(length: f64) {
    with_state(
        |state| {
            if let Some(file) = &mut state.file {
                file.set_length(length as u64);
            }
        },
        (),
    );
}

/// Runs one of [`operations::run`]; returns a [`Status`].
#[unsafe(no_mangle)]
pub extern "C" fn tsuya_run(operation: u32, argument: u32, flags: u32) -> u32 {
    with_state(
        |state| {
            // What was handed out before is freed first.
            state.outputs = Vec::new();
            let result = state.file.as_mut().map(|file| operations::run_operation(file, operation, argument, flags));
            let (status, outputs) = operations::answer(result, |answer| answer);
            state.outputs = outputs;
            status as u32
        },
        Status::Error as u32,
    )
}

/// Returns the address of an output; null if there are fewer.
#[unsafe(no_mangle)]
pub extern "C" fn tsuya_output(index: u32) -> *const u8 {
    let pointer = |state: &mut State| state.outputs.get(index as usize).map(|output| output.bytes().as_ptr());
    with_state(pointer, None).unwrap_or(std::ptr::null())
}

/// Bytes of an output.
#[unsafe(no_mangle)]
pub extern "C" fn tsuya_output_length(index: u32) -> u32 {
    with_state(|state| state.outputs.get(index as usize).map_or(0, |output| output.bytes().len() as u32), 0)
}

/// After a trap: where the code stopped, as text in the input. Returns its length; the text is at [`tsuya_panic`].
#[unsafe(no_mangle)]
pub extern "C" fn tsuya_panic_length() -> u32 {
    PANIC.with(|panic| panic.try_borrow().map_or(0, |text| text.len() as u32))
}

/// See [`tsuya_panic_length`].
#[unsafe(no_mangle)]
pub extern "C" fn tsuya_panic() -> *const u8 {
    PANIC.with(|panic| panic.try_borrow().map_or(std::ptr::null(), |text| text.as_ptr()))
}
