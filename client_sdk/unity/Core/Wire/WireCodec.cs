using System;
using System.Text;
using Terraport.Json;

namespace Terraport.Wire
{
    /// <summary>Messages to bytes and back (wire protocol, section 3).</summary>
    public static class WireCodec
    {
        private const int MaxTypeLength = 64;

        /// <summary>The subprotocol entry that carries a token where no header can be set (section 2.3).</summary>
        public static string TokenSubprotocol(string token)
        {
            // base64url without padding (RFC 4648, section 5): subprotocol names are HTTP tokens (RFC 9110).
            string text = Convert.ToBase64String(Encoding.UTF8.GetBytes(token));
            return "terraport.token." + text.Replace('+', '-').Replace('/', '_').TrimEnd('=');
        }

        /// <summary>
        /// Write a message. Keys stand in the order of the tables, the type first; absent fields are left out; the same message
        /// gives the same bytes every time.
        /// </summary>
        /// <exception cref="InvalidMessageException">A field is not what the protocol allows.</exception>
        public static byte[] Encode(WireMessage message)
        {
            if (message is UnknownMessage) throw new InvalidMessageException(message.Type, "type", "expected a message of the protocol");
            Check(message);
            return MsgpackWriter.Write(FieldTables.Write(message, message.Type));
        }

        /// <summary>Check a message that is to be sent; nothing is encoded.</summary>
        /// <exception cref="InvalidMessageException">A field is not what the protocol allows.</exception>
        public static void Check(WireMessage message)
        {
            try
            {
                FieldTables.Check(message);
                MessageRules.Check(message);
            }
            catch (RefusedException refused)
            {
                throw new InvalidMessageException(message.Type, refused.Path, refused.Message);
            }
        }

        /// <summary>Read the message that one binary WebSocket message holds; unknown keys are skipped.</summary>
        /// <param name="data">The bytes; nothing of the message refers to them afterwards.</param>
        /// <param name="direction">Who sent it.</param>
        /// <param name="maxBytes">A stricter limit than the protocol's own for this direction.</param>
        /// <returns>The message; <see cref="UnknownMessage"/> where its type is not known in that direction.</returns>
        /// <exception cref="DecodeException">It is no message, too long, or has a field that is not allowed.</exception>
        public static WireMessage Decode(ArraySegment<byte> data, Direction direction, int maxBytes = int.MaxValue)
        {
            int limit = direction == Direction.ClientToServer ? WireLimits.MaxClientMessageBytes : WireLimits.MaxServerMessageBytes;
            limit = Math.Min(limit, maxBytes);
            if (data.Count > limit)
            {
                throw new DecodeException("too_large", "got a message of " + data.Count + " bytes, expected at most " + limit);
            }
            // 1. Bytes to values, 2. values to the fields of its type, 3. rules between fields.
            JsonValue plain = MsgpackReader.Read(data, MaxValues(direction));
            if (plain.Kind != JsonKind.Object)
            {
                throw new DecodeException("malformed", "got " + plain.Show() + ", expected a map with a type");
            }
            string type = plain["type"].Text;
            if (type == null)
            {
                throw new DecodeException("malformed", "got type " + plain["type"].Show() + ", expected text");
            }
            WireMessage message = MessageTypes.Create(direction, type);
            if (message == null) return new UnknownMessage(Truncate(type));
            Read(message, plain);
            return message;
        }

        private static void Read(WireMessage message, JsonValue plain)
        {
            try
            {
                FieldTables.Read(message, plain);
                MessageRules.Check(message);
            }
            catch (RefusedException refused)
            {
                throw new DecodeException(message.Type, refused.Path, refused.Message, Readable("generation", message, plain),
                    Readable("request", message, plain));
            }
        }

        /// <summary>The values of a server's message are bounded by its bytes.</summary>
        private static int MaxValues(Direction direction)
        {
            return direction == Direction.ClientToServer ? WireLimits.MaxClientValues : int.MaxValue;
        }

        /// <summary>A refused message's number for the answer, where it has one that is in range.</summary>
        private static uint? Readable(string name, WireMessage message, JsonValue plain)
        {
            // Only fields that the type has: another message's number would be answered to nobody.
            if (!Array.Exists(message.Fields, field => field.Name == name)) return null;
            long value;
            bool isNumber = plain[name].TryInteger(out value) && value >= 0 && value <= uint.MaxValue;
            return isNumber ? (uint?)value : null;
        }

        /// <summary>At most so many characters of a type, none cut in two.</summary>
        private static string Truncate(string type)
        {
            int end = 0;
            for (int count = 0; count < MaxTypeLength && end < type.Length; count++)
            {
                end += end + 1 < type.Length && char.IsSurrogatePair(type[end], type[end + 1]) ? 2 : 1;
            }
            return type.Substring(0, end);
        }
    }
}
