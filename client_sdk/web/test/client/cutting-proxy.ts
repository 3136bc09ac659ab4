/** A small TCP proxy between a client and a server, whose line can be cut or made to stall. */

import type { AddressInfo } from "node:net";
import { connect, createServer, type Server, type Socket } from "node:net";

export interface CuttingProxy {
  /** Address that clients use instead of the server's. */
  readonly url: string;
  /** Connections so far. */
  connections: number;
  /** Bytes from the server so far. */
  downBytes: number;
  /** Cut each connection once so many bytes have come from the server; null never. */
  cutAfterBytes: number | null;
  /** Close new connections at once. */
  refuse: boolean;
  /** Cut every connection now, as a pulled cable would be noticed. */
  cut(): void;
  close(): Promise<void>;
}

/** Start one on a free port. */
export async function cuttingProxy(target: string): Promise<CuttingProxy> {
  const { hostname, port } = new URL(target);
  const open = new Set<Socket>();
  const server: Server = createServer((down) => {
    if (proxy.refuse) {
      down.destroy();
      return;
    }
    proxy.connections += 1;
    const up = connect(Number(port), hostname);
    let fromServer = 0;
    const end = () => {
      for (const socket of [up, down]) {
        open.delete(socket);
        socket.destroy();
      }
    };
    for (const socket of [up, down]) {
      open.add(socket);
      socket.on("error", end).on("close", end);
    }
    down.on("data", (data) => up.write(data));
    up.on("data", (data: Buffer) => {
      down.write(data);
      fromServer += data.length;
      proxy.downBytes += data.length;
      if (proxy.cutAfterBytes !== null && fromServer >= proxy.cutAfterBytes) end();
    });
  });
  await new Promise<void>((resolve) => server.listen(0, "127.0.0.1", resolve));
  const proxy: CuttingProxy = {
    url: `http://127.0.0.1:${(server.address() as AddressInfo).port}`,
    connections: 0,
    downBytes: 0,
    cutAfterBytes: null,
    refuse: false,
    cut: () => {
      for (const socket of open) socket.destroy();
    },
    close: () => {
      for (const socket of open) socket.destroy();
      return new Promise((resolve) => server.close(() => resolve()));
    },
  };
  return proxy;
}
