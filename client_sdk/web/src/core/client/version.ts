import { version } from "../../../package.json";

/** Name and version of this client, for the server's logs. */
export const CLIENT = `terraport-web/${version}`;
