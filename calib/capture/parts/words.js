/* What the page says in large letters, from what is known: pure, no element is touched here. */

const METRES_FROM_MM = 300; // as in the server's words
const OPPOSITE = { left: "right", right: "left", clockwise: "counterclockwise", counterclockwise: "clockwise" };

/** Directions as in a mirror: the server's are those of the photo. */
export function mirrored(text) {
  return text.replace(/\b(left|right|clockwise|counterclockwise)\b/giu, (word) => {
    const other = OPPOSITE[word.toLowerCase()];
    return word[0] === word[0].toUpperCase() ? other[0].toUpperCase() + other.slice(1) : other;
  });
}

/** As a sentence that is shown alone. */
export function capital(text) {
  return text.slice(0, 1).toUpperCase() + text.slice(1).replaceAll("->", "\u2192");
}

/**
 * What to do now.
 * @returns {{tone: "plain"|"hold"|"warn"|"good"|"fault", big: string, small: string}}
 */
export function instruction({ state, guidance, look, fault, isLost, isAsking, isWaiting, isMirrored }) {
  if (state && !state.is_here) return { tone: "fault", big: "Another tab has the session", small: "" };
  if (isLost && state?.phase !== "done") {
    return {
      tone: "fault",
      big: "Connection lost",
      small: "The photos are kept. If the program ended, start it again with --resume.",
    };
  }
  if (!state) return { tone: "plain", big: "Connecting", small: "" };
  const ofPhase = { ending, solving, done, failed }[state.phase];
  if (ofPhase) return ofPhase(state, guidance);
  const broken = state.sources.every((source) => source.fault) ? state.sources[0] : null; // others go on
  if (fault || broken) return { tone: "fault", big: fault || capital(broken.fault), small: "" };
  if (!guidance) return { tone: "plain", big: "Getting ready", small: state.target };
  if (isAsking) return { tone: "plain", big: "Let the browser use the camera", small: "It asks beside the address." };
  if (isWaiting) return { tone: "plain", big: "Getting ready", small: "The first look at a picture takes up to a minute." };
  return taking(state, guidance, look, isMirrored ? mirrored : (text) => text);
}

function ending(state, guidance) {
  const count = state.ends_in_s === null ? "" : `The calibration is computed in ${Math.ceil(state.ends_in_s)} s. `;
  const isAll = guidance?.stage === "exhausted";
  return {
    tone: isAll ? "plain" : "good",
    big: isAll ? "More photos would not help" : "Enough photos",
    small: count + (guidance?.headline ?? ""),
  };
}

function solving(state) {
  return { tone: "hold", big: "Computing the calibration", small: state.said };
}

/** What came of it stands in the report. */
function done(state, guidance) {
  const tone = guidance?.stage === "good" ? "good" : "plain";
  return { tone, big: "Done", small: `The report is kept in ${state.folder}; this page may be closed.` };
}

function failed(state) {
  return { tone: "fault", big: "No calibration", small: state.said };
}

function taking(state, guidance, look, seen) {
  const { ghost } = guidance;
  const place = ghost ? capital(seen(ghost.short)) : "";
  const isSeen = Boolean(look && look.look.outline_px.length > 0);
  const small = ghost ? numbers(ghost, isSeen ? look.look.cam_from_target : null) || capital(seen(ghost.sentence)) : guidance.headline;
  if (!look) {
    const isFolder = state.sources.length > 0 && state.sources.every((source) => source.kind === "folder");
    return { tone: "plain", big: place || (isFolder ? "Waiting for photos" : "Waiting for the camera"), small };
  }
  const note = forbidding(look.look);
  if (note) return { tone: "warn", big: capital(note.sentence), small };
  if (!isSeen) return { tone: "plain", big: place || "Show the target to the camera", small };
  if (look.look.is_wanted) return { tone: "hold", big: state.is_automatic ? "Hold still" : "Good: press space", small };
  const whose = state.sources.length > 1 ? `${state.sources[look.source].name}: ` : "";
  const hint = look.look.hint && whose + seen(look.look.hint);
  return { tone: "plain", big: capital(hint) || place || "Show another view", small };
}

/** What keeps this frame from being taken; motion only where nothing is left but to hold still. */
function forbidding(look) {
  const isThere = look.is_match || look.hint === "";
  return look.notes.find((note) => note.forbids && (note.name !== "motion" || isThere)) ?? null;
}

/** Distance and tilt, as they are, if that is known, and as they are to be. */
function numbers(ghost, pose) {
  const words = [];
  if (pose) words.push(`${metres(Math.hypot(pose[0][3], pose[1][3], pose[2][3]))} → ${metres(ghost.distance_mm)}`);
  if (ghost.tilt_deg !== null) {
    const goal = `${Math.round(ghost.tilt_deg)}°`;
    words.push(pose ? `tilt ${Math.round(tilt(pose))}° → ${goal}` : `tilt ${goal}`);
  }
  if (ghost.gain) words.push(capital(ghost.gain));
  return words.join("  ·  ");
}

/** Of a flat target against the sensor, in degrees. */
function tilt(pose) {
  return (Math.acos(Math.min(1, Math.abs(pose[2][2]))) * 180) / Math.PI;
}

function metres(mm) {
  return mm < METRES_FROM_MM ? `${Math.round(mm)} mm` : `${(mm / 1000).toFixed(2)} m`;
}
