// WebSockets for WebGL builds, polled by WebGlTransport.cs: nothing is called back. How much may wait is bounded by the credit.
var TerraportSockets = {
  $terraportSockets: { next: 1, open: {} },

  TerraportSocketOpen: function (url, protocols) {
    var id = terraportSockets.next++;
    var entry = { socket: null, state: 0, code: 1006, reason: "", received: [] };
    terraportSockets.open[id] = entry;
    try {
      entry.socket = new WebSocket(UTF8ToString(url), UTF8ToString(protocols).split(","));
    } catch (error) {
      entry.state = 2;
      entry.reason = String(error);
      return id;
    }
    entry.socket.binaryType = "arraybuffer";
    entry.socket.onopen = function () {
      entry.state = 1;
    };
    entry.socket.onmessage = function (event) {
      entry.received.push(typeof event.data === "string" ? new Uint8Array(0) : new Uint8Array(event.data));
    };
    entry.socket.onclose = function (event) {
      entry.state = 2;
      entry.code = event.code;
      entry.reason = event.reason;
    };
    return id;
  },
  TerraportSocketOpen__deps: ["$terraportSockets"],

  // 0 connecting, 1 open, 2 closed.
  TerraportSocketState: function (id) {
    return terraportSockets.open[id].state;
  },
  TerraportSocketState__deps: ["$terraportSockets"],

  TerraportSocketCloseCode: function (id) {
    return terraportSockets.open[id].code;
  },
  TerraportSocketCloseCode__deps: ["$terraportSockets"],

  // As UTF-8 into the buffer, cut to its size; returns its bytes.
  TerraportSocketReason: function (id, buffer, capacity) {
    var bytes = new TextEncoder().encode(terraportSockets.open[id].reason).subarray(0, capacity);
    HEAPU8.set(bytes, buffer);
    return bytes.length;
  },
  TerraportSocketReason__deps: ["$terraportSockets"],

  // Bytes of the next message, or -1.
  TerraportSocketNextLength: function (id) {
    var received = terraportSockets.open[id].received;
    return received.length > 0 ? received[0].length : -1;
  },
  TerraportSocketNextLength__deps: ["$terraportSockets"],

  TerraportSocketTake: function (id, buffer) {
    HEAPU8.set(terraportSockets.open[id].received.shift(), buffer);
  },
  TerraportSocketTake__deps: ["$terraportSockets"],

  TerraportSocketSend: function (id, buffer, length) {
    var entry = terraportSockets.open[id];
    if (entry.state === 1) entry.socket.send(HEAPU8.slice(buffer, buffer + length));
  },
  TerraportSocketSend__deps: ["$terraportSockets"],

  TerraportSocketClose: function (id, code, reason) {
    var entry = terraportSockets.open[id];
    // Pages may close with 1000 and 3000 to 4999 alone.
    if (entry.socket && entry.state !== 2) entry.socket.close(code === 1000 || code >= 3000 ? code : 1000, UTF8ToString(reason));
  },
  TerraportSocketClose__deps: ["$terraportSockets"],

  TerraportSocketForget: function (id) {
    delete terraportSockets.open[id];
  },
  TerraportSocketForget__deps: ["$terraportSockets"],
};

mergeInto(LibraryManager.library, TerraportSockets);
