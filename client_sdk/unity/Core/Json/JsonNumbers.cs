using System;
using System.Globalization;
using System.Text;

namespace Terraport.Json
{
    /// <summary>
    /// Numbers of JSON, correctly rounded, without an allocation where their digits fit 53 bits and their exponent is small (the
    /// product of two exact numbers is rounded once), or where the same digits were read before.
    /// </summary>
    internal sealed class JsonNumbers
    {
        // Clinger's fast path (W. Clinger, "How to read floating point numbers accurately", 1990): both factors exact, so one rounding.
        private const long MaxExactInteger = 1L << 53;
        // 10^22 is the largest power of ten that float64 holds exactly.
        private const int MaxExactExponent = 22;
        // A document repeats few long numbers (steps, offsets): a direct-mapped cache is enough, and is bounded.
        private const int CacheSlots = 64;

        private static readonly double[] PowersOfTen = { 1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14,
            1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22 };

        private readonly byte[][] cachedDigits = new byte[CacheSlots][];
        private readonly double[] cachedValues = new double[CacheSlots];

        /// <summary>Length in bytes of the number at <paramref name="at"/> by JSON's grammar; 0 where there is none.</summary>
        internal static int LengthAt(byte[] bytes, int at, int end)
        {
            int start = at;
            // RFC 8259, section 6: [minus] int [frac] [exp]; no leading zero, no empty fraction or exponent.
            at += at < end && bytes[at] == '-' ? 1 : 0;
            int digits = DigitsAt(bytes, at, end);
            if (digits == 0 || (digits > 1 && bytes[at] == '0'))
            {
                return 0;
            }
            at += digits;
            if (at < end && bytes[at] == '.')
            {
                digits = DigitsAt(bytes, at + 1, end);
                if (digits == 0)
                {
                    return 0;
                }
                at += 1 + digits;
            }
            // | 32 folds an upper-case E into the lower-case one.
            if (at < end && (bytes[at] | 32) == 'e')
            {
                at++;
                at += at < end && (bytes[at] == '+' || bytes[at] == '-') ? 1 : 0;
                digits = DigitsAt(bytes, at, end);
                if (digits == 0)
                {
                    return 0;
                }
                at += digits;
            }
            return at - start;
        }

        /// <summary>The value of a number whose grammar was checked.</summary>
        internal double Get(byte[] bytes, int start, int length)
        {
            double value;
            return TryExact(bytes, start, length, out value) ? value : GetCached(bytes, start, length);
        }

        private static int DigitsAt(byte[] bytes, int at, int end)
        {
            int start = at;
            while (at < end && bytes[at] >= '0' && bytes[at] <= '9')
            {
                at++;
            }
            return at - start;
        }

        private static bool TryExact(byte[] bytes, int start, int length, out double value)
        {
            value = 0;
            int at = start;
            int end = start + length;
            bool isNegative = bytes[at] == '-';
            at += isNegative ? 1 : 0;
            // 1. Mantissa: all digits as one integer; those behind the point lower the exponent.
            // Invariant: the value read so far is digits * 10^exponent, exactly.
            long digits = 0;
            int exponent = 0;
            bool isFraction = false;
            for (; at < end && (bytes[at] | 32) != 'e'; at++)
            {
                if (bytes[at] == '.')
                {
                    isFraction = true;
                    continue;
                }
                digits = digits * 10 + (bytes[at] - '0');
                exponent -= isFraction ? 1 : 0;
                // Tested at each digit, so the product above never overflows 64 bits.
                if (digits > MaxExactInteger)
                {
                    return false;
                }
            }
            // 2. Stated exponent, added to the one from the fraction.
            if (at < end)
            {
                at++;
                bool isExponentNegative = bytes[at] == '-';
                at += isExponentNegative || bytes[at] == '+' ? 1 : 0;
                int statedExponent = 0;
                for (; at < end; at++)
                {
                    statedExponent = statedExponent * 10 + (bytes[at] - '0');
                    // Far beyond float64 already; going on would overflow the counter on a hostile run of digits.
                    if (statedExponent > 1000)
                    {
                        return false;
                    }
                }
                exponent += isExponentNegative ? -statedExponent : statedExponent;
            }
            // 3. One multiplication or division of two exact numbers: IEEE 754 rounds it correctly.
            if (exponent < -MaxExactExponent || exponent > MaxExactExponent)
            {
                return false;
            }
            value = exponent < 0 ? digits / PowersOfTen[-exponent] : digits * PowersOfTen[exponent];
            value = isNegative ? -value : value;
            return true;
        }

        /// <summary>Any number, by the platform's parser, through the cache: the same digits allocate once.</summary>
        private double GetCached(byte[] bytes, int start, int length)
        {
            int slot = JsonTexts.SlotOf(bytes, start, length, CacheSlots);
            if (!JsonTexts.IsSame(cachedDigits[slot], bytes, start, length))
            {
                double value;
                string text = Encoding.ASCII.GetString(bytes, start, length);
                if (!double.TryParse(text, NumberStyles.Float, CultureInfo.InvariantCulture, out value))
                {
                    // The grammar was checked, so that what does not parse is beyond the range: .NET before 3.0 says so.
                    value = text[0] == '-' ? double.NegativeInfinity : double.PositiveInfinity;
                }
                cachedDigits[slot] = JsonTexts.CopyOf(bytes, start, length);
                cachedValues[slot] = value;
            }
            return cachedValues[slot];
        }
    }
}
