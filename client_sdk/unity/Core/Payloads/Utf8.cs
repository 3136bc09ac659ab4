namespace Terraport
{
    /// <summary>Whether bytes are UTF-8 (RFC 3629), without making a text of them.</summary>
    internal static class Utf8
    {
        /// <summary>No byte out of place, no longer form than needed, no surrogate, nothing above U+10FFFF.</summary>
        internal static bool IsValid(byte[] bytes, int offset, int length)
        {
            int end = offset + length;
            int at = offset;
            while (at < end)
            {
                byte first = bytes[at++];
                if (first < 0x80)
                {
                    continue;
                }
                // RFC 3629, section 4. C0, C1 and F5 to FF start nothing; 80 to BF only follow.
                int trailing = first >= 0xC2 && first <= 0xDF ? 1
                    : first >= 0xE0 && first <= 0xEF          ? 2
                    : first >= 0xF0 && first <= 0xF4          ? 3
                                                              : 0;
                if (trailing == 0 || end - at < trailing)
                {
                    return false;
                }
                byte second = bytes[at];
                // The second byte alone rules out longer forms than needed (E0, F0), surrogates (ED) and what is above U+10FFFF (F4).
                byte minSecond = first == 0xE0 ? (byte)0xA0 : first == 0xF0 ? (byte)0x90 : (byte)0x80;
                byte maxSecond = first == 0xED ? (byte)0x9F : first == 0xF4 ? (byte)0x8F : (byte)0xBF;
                if (second < minSecond || second > maxSecond)
                {
                    return false;
                }
                for (int index = at + 1; index < at + trailing; index++)
                {
                    if ((bytes[index] & 0xC0) != 0x80)
                    {
                        return false;
                    }
                }
                at += trailing;
            }
            return true;
        }
    }
}
