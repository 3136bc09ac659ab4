using System;
using System.Globalization;
using System.Text;

namespace Terraport.Json
{
    /// <summary>
    /// Texts of JSON: the same bytes give the same object, as far as a small cache reaches, so that names are allocated once.
    /// </summary>
    internal sealed class JsonTexts
    {
        private const int CacheSlots = 64;
        private readonly byte[][] cachedBytes = new byte[CacheSlots][];
        private readonly string[] cachedTexts = new string[CacheSlots];

        /// <summary>The text between two quotation marks, whose escapes were checked.</summary>
        internal string Get(byte[] bytes, int start, int length, bool hasEscapes)
        {
            int slot = SlotOf(bytes, start, length, CacheSlots);
            // Direct-mapped: a colliding text takes the slot over, so the cache never grows.
            if (cachedTexts[slot] == null || !IsSame(cachedBytes[slot], bytes, start, length))
            {
                string text = Encoding.UTF8.GetString(bytes, start, length);
                cachedBytes[slot] = CopyOf(bytes, start, length);
                cachedTexts[slot] = hasEscapes ? Unescape(text) : text;
            }
            return cachedTexts[slot];
        }

        /// <summary>Bytes of the escape at a backslash.</summary>
        /// <exception cref="JsonException">It is none, or cut short.</exception>
        internal static int EscapeLength(byte[] bytes, int at, int end)
        {
            byte kind = at + 1 < end ? bytes[at + 1] : (byte)0;
            if (kind != 'u')
            {
                if (kind == 0 || "\"\\/bfnrt".IndexOf((char)kind) < 0)
                {
                    throw new JsonException("an unknown escape", at);
                }
                return 2;
            }
            for (int digitAt = at + 2; digitAt < at + 6; digitAt++)
            {
                if (digitAt >= end || !Uri.IsHexDigit((char)bytes[digitAt]))
                {
                    throw new JsonException("an escape of no four digits", at);
                }
            }
            return 6;
        }

        internal static int SlotOf(byte[] bytes, int start, int length, int slots)
        {
            // A good hash: keys of one document differ in a few letters at the end.
            return (int)(Xxh3.Hash64(bytes, start, length) % (uint)slots);
        }

        internal static bool IsSame(byte[] cached, byte[] bytes, int start, int length)
        {
            if (cached == null || cached.Length != length)
            {
                return false;
            }
            for (int at = 0; at < length; at++)
            {
                if (cached[at] != bytes[start + at])
                {
                    return false;
                }
            }
            return true;
        }

        internal static byte[] CopyOf(byte[] bytes, int start, int length)
        {
            var copy = new byte[length];
            Buffer.BlockCopy(bytes, start, copy, 0, length);
            return copy;
        }

        /// <summary>Replace the escapes of a text that <see cref="EscapeLength"/> has accepted.</summary>
        private static string Unescape(string text)
        {
            var plain = new StringBuilder(text.Length);
            for (int at = 0; at < text.Length; at++)
            {
                if (text[at] != '\\')
                {
                    plain.Append(text[at]);
                    continue;
                }
                at++;
                if (text[at] == 'u')
                {
                    // Halves of a surrogate pair come as two escapes; side by side they are the pair again.
                    plain.Append((char)int.Parse(text.Substring(at + 1, 4), NumberStyles.HexNumber, CultureInfo.InvariantCulture));
                    at += 4;
                    continue;
                }
                int kind = "bfnrt".IndexOf(text[at]);
                plain.Append(kind < 0 ? text[at] : "\b\f\n\r\t"[kind]);
            }
            return plain.ToString();
        }
    }
}
