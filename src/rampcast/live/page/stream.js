// The line to the service: messages of one site over a WebSocket that is taken up again when it breaks.

const [SHORTEST, LONGEST] = [300, 5000]; // [ms] until the next try
const NO_TOKEN = 1008; // the code with which a service closes that wants a token, or another one

export class Stream {
  constructor(site, { onMessage, onState, askToken }, token = null) {
    Object.assign(this, { site, onMessage, onState, askToken, pause: SHORTEST, token, asked: false });
    this.open();
  }

  open() {
    const scheme = location.protocol === "https:" ? "wss:" : "ws:";
    this.socket = new WebSocket(`${scheme}//${location.host}/v1/sites/${encodeURIComponent(this.site)}/live`);
    this.socket.onopen = () => {
      if (this.token) this.socket.send(JSON.stringify({ token: this.token }));
      this.onState("open");
    };
    this.socket.onmessage = ({ data }) => {
      this.pause = SHORTEST;
      this.onMessage(JSON.parse(data));
    };
    this.socket.onclose = ({ code }) => this.closed(code);
  }

  async closed(code) {
    if (this.ended) return;
    this.onState("lost");
    if (code === NO_TOKEN && !this.asked) {
      this.asked = true;
      this.token = await this.askToken();
      this.asked = false;
    } else {
      await new Promise((done) => { setTimeout(done, this.pause); });
      this.pause = Math.min(2 * this.pause, LONGEST);
    }
    if (!this.ended) this.open();
  }

  close() {
    this.ended = true;
    this.socket.close();
  }
}

export async function fetched(path, token = null, options = {}) {
  const headers = { ...(token ? { Authorization: `Bearer ${token}` } : {}), ...(options.headers ?? {}) };
  const answer = await fetch(path, { ...options, headers });
  if (!answer.ok) throw Object.assign(new Error(`${path}: ${answer.status}`), { status: answer.status });
  return answer.json();
}
