// Connection to the service by MessagePack, which reconnects.
const FIRST_MS = 300, LONGEST_MS = 5000;

export class Stream {
  constructor(onMessage, onState) {
    this.onMessage = onMessage;
    this.onState = onState;
    this.waitMs = FIRST_MS;
    this.open();
    addEventListener("online", () => this.hurry());
    document.addEventListener("visibilitychange", () => document.hidden || this.hurry());
  }

  open() {
    this.timer = null;
    const url = new URL("stream", location.href);
    url.protocol = url.protocol.replace("http", "ws");
    url.hash = url.search = "";
    const socket = new WebSocket(url);
    this.socket = socket;
    socket.binaryType = "arraybuffer";
    socket.onopen = () => { this.waitMs = FIRST_MS; this.onState(true); };
    socket.onmessage = ({ data }) => {
      if (data instanceof ArrayBuffer) this.onMessage(MessagePack.decode(new Uint8Array(data)));
    };
    socket.onclose = ({ code, reason }) => {
      this.onState(false, code === 1013 ? reason : "");
      this.timer = setTimeout(() => this.open(), this.waitMs);
      this.waitMs = Math.min(this.waitMs * 2, LONGEST_MS);
    };
  }

  hurry() {
    if (this.timer === null) return;
    clearTimeout(this.timer);
    this.waitMs = FIRST_MS;
    this.open();
  }

  send(request) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(MessagePack.encode(request));
  }
}
