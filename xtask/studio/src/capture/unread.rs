//! What a calibration states that is not read, in a note: [`unread_note`]. Values that state nothing are none of it:
//! [`is_stated`].

use formats::list_of;
use serde_json::Value;

/// The note on keys that are not read; `who` is the subject and the verb. `None` of no key.
pub(crate) fn unread_note<'k>(who: &str, keys: impl Iterator<Item = &'k str>) -> Option<String> {
    Some(format!("{who} what is not read: {}", list_of(keys)?))
}

/// Whether a value states something: it is not null, false or 0, and not of such values only.
pub(crate) fn is_stated(value: &Value) -> bool {
    match value {
        Value::Null | Value::Bool(false) => false,
        Value::Number(number) => number.as_f64() != Some(0.0),
        Value::Array(values) => values.iter().any(is_stated),
        _ => true,
    }
}
