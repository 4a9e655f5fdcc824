//! Reads the intent that started the activity, and the activity's folders, through JNI.

#![allow(unsafe_code, reason = "the activity is a reference of Java's")]

use std::path::PathBuf;

use android_activity::AndroidApp;
use jni::objects::JString;
use jni::refs::{Global, Reference};
use jni::{Env, JavaVM};

use super::request::IntentRequest;

/// Names of the extras that the player reads.
const CLIP: &str = "clip";
const OPTIONS: &str = "args";

jni::bind_java_type! {
    Uri => "android.net.Uri",
    methods {
        fn get_scheme() -> JString,
        fn get_path() -> JString,
        fn to_string() -> JString,
    }
}

jni::bind_java_type! {
    Intent => "android.content.Intent",
    type_map { Uri => "android.net.Uri" },
    methods {
        fn get_data() -> Uri,
        fn get_string_extra(name: JString) -> JString,
    }
}

jni::bind_java_type! {
    File => "java.io.File",
    methods {
        fn get_path() -> JString,
    }
}

jni::bind_java_type! {
    Activity => "android.app.Activity",
    type_map { Intent => "android.content.Intent", File => "java.io.File" },
    methods {
        fn get_intent() -> Intent,
        fn get_cache_dir() -> File,
    }
}

/// Reads the intent; an unreadable one is empty, with a warning.
pub(in crate::xr) fn read(app: &AndroidApp) -> IntentRequest {
    with_activity(app, request).unwrap_or_else(|error| {
        log::warn!("the intent cannot be read: {error}");
        IntentRequest::default()
    })
}

/// The folder for files that can be made again; `None`, with a warning, if there is none.
pub(super) fn cache_folder(app: &AndroidApp) -> Option<PathBuf> {
    let folder = with_activity(app, |env, activity| {
        let folder = activity.get_cache_dir(env)?;
        let path = folder.get_path(env)?;
        text(env, &path)
    });
    let folder = folder.unwrap_or_else(|error| {
        log::warn!("the folder for cached files is not known: {error}");
        None
    });
    folder.map(PathBuf::from)
}

/// Calls `ask` with the Java object of the activity.
fn with_activity<T>(
    app: &AndroidApp,
    ask: impl FnOnce(&mut Env<'_>, &Activity<'_>) -> jni::errors::Result<T>,
) -> jni::errors::Result<T> {
    JavaVM::singleton()?.attach_current_thread(|env| {
        let activity = app.activity_as_ptr().cast();
        // SAFETY: it is a global reference to the activity, valid as long as `app`.
        let activity = unsafe { env.as_cast_raw::<Global<Activity<'static>>>(&activity) }?;
        ask(env, &activity)
    })
}

fn request(env: &mut Env<'_>, activity: &Activity<'_>) -> jni::errors::Result<IntentRequest> {
    let intent = activity.get_intent(env)?;
    if intent.is_null() {
        return Ok(IntentRequest::default());
    }
    let mut extra = |name: &str| {
        let name = env.new_string(name)?;
        let value = intent.get_string_extra(env, &name)?;
        text(env, &value)
    };
    let (clip, options) = (extra(CLIP)?, extra(OPTIONS)?);
    Ok(IntentRequest { clip: data(env, &intent)?.or(clip), options })
}

/// The data of an intent: the path of a file, or any other URL as it is.
fn data(env: &mut Env<'_>, intent: &Intent<'_>) -> jni::errors::Result<Option<String>> {
    let uri = intent.get_data(env)?;
    if uri.is_null() {
        return Ok(None);
    }
    let scheme = uri.get_scheme(env)?;
    let is_file = text(env, &scheme)?.is_none_or(|scheme| scheme == "file");
    let name = if is_file { uri.get_path(env)? } else { uri.to_string(env)? };
    text(env, &name)
}

/// The text of a Java string; `None` for null.
fn text(env: &Env<'_>, string: &JString<'_>) -> jni::errors::Result<Option<String>> {
    if string.is_null() { Ok(None) } else { string.try_to_string(env).map(Some) }
}
