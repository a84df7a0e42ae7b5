/* The socket to the server: calib/capture/messages.py says what goes over it. */

const AGAIN_MS = 1000;

/**
 * @param {{message: (message: object) => void, image: (header: object, bytes: Uint8Array) => void,
 *   open: () => void, lost: () => void}} on
 */
export function connect(on) {
  let socket = null;
  let isWanted = true;

  function start() {
    const address = new URL("socket", window.location.href);
    address.protocol = address.protocol.replace("http", "ws");
    socket = new WebSocket(address);
    socket.binaryType = "arraybuffer";
    socket.onopen = on.open;
    socket.onmessage = ({ data }) => {
      if (typeof data === "string") on.message(JSON.parse(data));
      else on.image(...withoutHeader(data));
    };
    socket.onclose = () => {
      on.lost();
      if (isWanted) setTimeout(start, AGAIN_MS);
    };
  }

  start();
  const isOpen = () => socket.readyState === WebSocket.OPEN;
  return {
    command(kind, name = "") {
      if (isOpen()) socket.send(JSON.stringify({ kind, name }));
    },
    /** Whether what was sent has left. */
    isFree: () => isOpen() && socket.bufferedAmount === 0,
    frame(header, grey) {
      if (isOpen()) socket.send(withHeader(header, grey));
    },
    /** Another tab has the session, or it is over: do not come back. */
    stayAway() { isWanted = false; },
  };
}

/** Four bytes, little-endian, for the length of a JSON header, the header, and the bytes of the image. */
function withHeader(header, image) {
  const head = new TextEncoder().encode(JSON.stringify(header));
  const message = new Uint8Array(4 + head.length + image.length);
  new DataView(message.buffer).setUint32(0, head.length, true);
  message.set(head, 4);
  message.set(image, 4 + head.length);
  return message;
}

function withoutHeader(data) {
  const length = new DataView(data).getUint32(0, true);
  const head = new TextDecoder().decode(new Uint8Array(data, 4, length));
  return [JSON.parse(head), new Uint8Array(data, 4 + length)];
}
